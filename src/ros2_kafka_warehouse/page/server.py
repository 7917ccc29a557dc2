"""The process of the page: a socket, uvicorn, and an orderly end."""

import signal
import socket
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import typer
import uvicorn

from ros2_kafka_bridge.web.guard import names_of
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page.app import Page, make_app
from ros2_kafka_warehouse.page.failures import FAILURES

_BACKLOG: Final = 100
_ENDINGS: Final = (signal.SIGINT, signal.SIGTERM)


class CannotListen(Exception):  # noqa: N818 (what happened)
    """The address is taken or not ours."""


class PartFailed(Exception):  # noqa: N818 (what happened)
    """A part of the page ended by an error; the log has it."""


class Where(NamedTuple):
    """Where Kafka is, where the page listens, and under which other names it is known."""

    bootstrap_servers: str
    host: str = '127.0.0.1'
    port: int = 8080
    more_names: tuple[str, ...] = ()


def run(
    site: Site, where: Where, orders_per_minute: float = 0.0, alive: Path | None = None
) -> None:
    """Serve until SIGINT or SIGTERM; touch `alive` meanwhile.

    Raises:
        CannotListen: The address is taken or not ours.
        PartFailed: It could not go on.
    """
    host = where.host
    with _listen(host, where.port) as listener:
        port = listener.getsockname()[1]
        server: uvicorn.Server
        failed = False

        def stopping() -> bool:
            return server.should_exit

        def give_up() -> None:
            nonlocal failed
            failed = server.should_exit = True

        names = names_of(host, port, where.more_names)
        page = Page(
            site,
            FAILURES,
            where.bootstrap_servers,
            names,
            stopping,
            give_up,
            orders_per_minute,
            alive,
        )
        config = uvicorn.Config(
            make_app(page),
            lifespan='on',
            log_level='warning',
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=3,
        )
        server = uvicorn.Server(config)
        shown = f'[{host}]' if ':' in host else host
        typer.echo(f'The warehouse is shown at http://{shown}:{port}/')
        # When it has ended in order, uvicorn raises the signal anew for whoever had it before.
        for number in _ENDINGS:
            signal.signal(number, _leave)
        server.run(sockets=[listener])
        if failed:
            raise PartFailed('a part has failed; see above')


def _leave(*_: Any) -> NoReturn:
    raise SystemExit(0)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        # uvicorn listens when the page has read Kafka: until then who follows the link waits.
        listener.listen(_BACKLOG)
    except OSError as error:
        raise CannotListen(
            f'cannot listen on {host}, port {port}: {error.strerror}; choose another with --port'
        ) from error
    return listener
