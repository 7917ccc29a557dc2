"""What whoever answers at an address says of itself, which may be anybody: so much, so long."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException, HTTPResponse, InvalidURL
from typing import Final, NamedTuple

import msgspec

from ros2_kafka_bridge.config.monitoring import Address
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.text import printable

PATIENCE_S: Final = 10.0
MOST_BYTES: Final = 16_000_000
"""Of an answer: that of some ten thousand routes."""

_EVERY_ADDRESS: Final = {'0.0.0.0': '127.0.0.1', '::': '::1'}  # noqa: S104 (only compared)
_PIECE_BYTES: Final = 65_536
_LONGEST: Final = 200


class BridgeState(msgspec.Struct, frozen=True):
    """The bridge as a whole."""

    name: str
    ready: bool
    lifecycle: str | None
    problems: list[str]
    old: bool
    report_age_s: float


class EndedState(msgspec.Struct, frozen=True):
    """How many messages have ended in which way."""

    dead_lettered: int | None


class RouteState(msgspec.Struct, frozen=True):
    """A route; None is what is not known."""

    name: str
    state: str
    reason: str
    rate: float | None
    delay_s: tuple[float, float] | None
    lag: int | None
    in_flight: int | None
    spooled: int | None
    ended: EndedState
    age_s: float | None
    memory_limit: int | None = None  # older bridges do not tell it


class WorkerState(msgspec.Struct, frozen=True):
    """A process of the bridge, and what is wrong with it."""

    number: int
    problem: str


class BrokerState(msgspec.Struct, frozen=True):
    """What is wrong with Kafka."""

    problem: str


class ShownState(msgspec.Struct, frozen=True):
    """What `status` shows of `/api/state`."""

    bridge: BridgeState
    routes: list[RouteState]
    workers: list[WorkerState]
    broker: BrokerState | None


class Told(NamedTuple):
    """What a bridge has answered.

    Args:
        state: What is shown of it.
        body: All of it, which is JSON.
    """

    state: ShownState
    body: bytearray


def ask(address: Address, runs: str, patience_s: float = PATIENCE_S) -> Told:
    """Ask a bridge how it is doing.

    Args:
        address: Where it listens.
        runs: What it has to be run with, to answer there.
        patience_s: How long each of its addresses may take to connect, then the whole answer.

    Raises:
        ConfigError: Nobody answers there, or no bridge.
    """
    body = _body(address, runs, patience_s)
    try:
        return Told(msgspec.json.decode(body, type=ShownState), body)
    except msgspec.ValidationError as error:
        raise _no_bridge(address, f', or one of another version ({_shown(error)})') from None
    except (msgspec.DecodeError, RecursionError):
        raise _no_bridge(address) from None


def _body(address: Address, runs: str, patience_s: float) -> bytearray:
    """All that is answered, if it can be a bridge's and ends in time."""
    host = _EVERY_ADDRESS.get(address.host, address.host)
    try:
        connection = HTTPConnection(host, address.port, timeout=patience_s)
        connection.connect()
        with contextlib.closing(connection), _in_time(connection.sock, patience_s):
            connection.request('GET', '/api/state')
            with connection.getresponse() as answer:
                body = _read(answer)
    except (OSError, UnicodeError, InvalidURL) as error:  # a name that cannot be one of DNS, too
        text = f'{printable(address)} does not answer ({_shown(error)})'
        raise ConfigError([f'{text}: does a bridge run with {runs}?']) from None
    except (HTTPException, ValueError) as error:
        raise _no_bridge(address, f' ({type(error).__name__}: {_shown(error)})') from None
    if answer.status != HTTPStatus.OK:
        raise _no_bridge(address, f' ({_phrase(answer.status)})')
    if len(body) > MOST_BYTES:
        raise _no_bridge(address, f': its answer has more than {MOST_BYTES:,} bytes')
    return body


def _read(answer: HTTPResponse) -> bytearray:
    """The body, or as much of it as shows that it is too long."""
    body = bytearray()
    while len(body) <= MOST_BYTES and (piece := answer.read1(_PIECE_BYTES)):
        body += piece
    return body


@contextlib.contextmanager
def _in_time(connected: socket.socket, patience_s: float) -> Iterator[None]:
    """End a connection when the time is up: its own timeout is for each piece of an answer."""
    is_late = threading.Event()

    def end() -> None:
        is_late.set()
        with contextlib.suppress(OSError):
            connected.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(patience_s, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        if is_late.is_set():
            raise TimeoutError(f'not to its end within {patience_s:g} s') from None


def _no_bridge(address: Address, why: str = '') -> ConfigError:
    return ConfigError([f'{printable(address)}: what answers there is no bridge{why}'])


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return f'status {status}'


def _shown(error: Exception) -> str:
    return printable(str(error)[:_LONGEST])
