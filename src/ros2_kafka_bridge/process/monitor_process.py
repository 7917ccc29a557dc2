"""The process that watches the bridge, as its supervisor sees it.

It holds no route: one that dies is started again, and the routes never notice. What it is told
never holds the supervisor up, either: of the reports only the newest waits for it.
"""

import contextlib
import errno
import selectors
import socket
import time
from collections.abc import Callable
from typing import Final

import msgspec

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.plan import OFF
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Report, Request

_UNREAD_BYTES: Final = 1024 * 1024  # answers to one that asks and does not read
_PATIENCE_S: Final = 60.0
_CLOSING_S: Final = 5.0
_CLOSING_LOOK_S: Final = 0.01
_BACKLOG: Final = 128

_REQUESTS: Final = msgspec.json.Decoder(Request)


def bind(listen: str, file: str) -> socket.socket | None:
    """Take the address where the bridge is watched; None for none.

    Args:
        listen: `host:port`, with an IPv6 host in brackets; or `off`.
        file: The configuration, for the message.

    Raises:
        ConfigError: It is in use, or is none of this machine.
    """
    if listen == OFF:
        return None
    host, _, port = listen.rpartition(':')
    where = f'{file}: monitoring.listen: {listen}'
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host.strip('[]'), int(port), type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except OSError as error:
        raise ConfigError([f'{where}: no such host here ({error.strerror})']) from error
    made = socket.socket(family, kind, protocol)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            # Without it, [::] would take the port of IPv4, too, or not, as the machine is set.
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, int(host != '[::]'))
        made.bind(address)
        made.listen(_BACKLOG)
    except OSError as error:
        made.close()
        raise ConfigError([f'{where}: {_cure(error, port)}']) from error
    return made


def _cure(error: OSError, port: str) -> str:
    match error.errno:
        case errno.EADDRINUSE:
            return (
                f'port {port} is in use: another program listens there, or another bridge: '
                'choose another port, or listen: off'
            )
        case errno.EADDRNOTAVAIL:
            return 'this machine has no such address: 127.0.0.1 is always there'
        case errno.EACCES:
            return f'this user may not listen on port {port}: choose one from 1024 on'
        case _:
            return f'cannot be listened on: {error.strerror}'


class MonitorProcess:
    """Starts the process, starts it again, and speaks with it.

    Args:
        listener: The socket where it listens; None for none.
        log_format: How it writes a line of the log.
        selector: Where what it says is waited for.
        on_request: Called with what it asks for, and what takes the answer.
    """

    def __init__(
        self,
        listener: socket.socket | None,
        log_format: str,
        selector: selectors.BaseSelector,
        on_request: Callable[[Request, Callable[[Answer], None]], None],
    ) -> None:
        self._listener = listener
        self._log_format = log_format
        self._on_request = on_request
        self._log = logs.route_log()
        self._process = ChildProcess('monitoring', 'requests', selector)
        self._lives = 0
        self._started_s = 0.0
        self._configured = self._report = b''

    @property
    def next_look_s(self) -> float:
        """When to look at it at the latest."""
        return self._process.next_look_s

    def configure(self, configured: Configured) -> None:
        """Tell which configuration counts, now and at each further start."""
        self._configured = _line(configured)
        self._process.send(self._configured)

    def report(self, report: Report) -> None:
        """Tell how the bridge is doing, in the place of a report that still waits."""
        self._report = _line(report)

    def tick(self) -> None:
        """Start it if it is due, tell it what waits, and do what it asks for."""
        status = self._process.exit_status()
        for line in self._process.exchange():
            with contextlib.suppress(ValueError):
                self._on_request(_REQUESTS.decode(line), self._answerer())
        if status is not None:
            how = f'status {status}' if status >= 0 else f'signal {-status}'
            self._fail(f'has ended ({how})')
        if self._process.is_due:
            self._start()
        self._send_report()
        if self._process.stuck_s > _PATIENCE_S:
            self._log.error('the monitor takes nothing any more: it is killed')
            self._process.kill()

    def _send_report(self) -> None:
        if self._process.is_running and not self._process.unsent_bytes:
            self._process.send(self._report)
            self._report = b''

    def _start(self) -> None:
        self._lives += 1
        self._started_s = time.monotonic()
        options = [f'--log-format={self._log_format}']
        kept = [] if self._listener is None else [self._listener.fileno()]
        options += [f'--socket={descriptor}' for descriptor in kept]
        try:
            self._process.start(options, kept)
        except OSError as error:
            self._fail(f'could not be started ({error.strerror})')
            return
        self._process.send(self._configured)
        self._log.info('the monitor is process %d', self._process.pid)

    def _fail(self, how: str) -> None:
        wait_s = self._process.start_later(time.monotonic() - self._started_s)
        self._log.error('the monitor %s: started again in %.0f s; the routes go on', how, wait_s)

    def _answerer(self) -> Callable[[Answer], None]:
        """What takes an answer to a request of this life of the process."""
        life = self._lives

        def answer(answer: Answer) -> None:
            if life == self._lives and self._process.unsent_bytes < _UNREAD_BYTES:
                self._process.send(_line(answer))

        return answer

    def close(self) -> None:
        """Let it say the last report, and end; one that does not is killed."""
        deadline_s = time.monotonic() + _CLOSING_S
        while self._process.is_running and time.monotonic() < deadline_s:
            self._process.exchange()
            self._send_report()
            if not (self._report or self._process.unsent_bytes):
                self._process.close_input()
            self._process.exit_status()
            time.sleep(_CLOSING_LOOK_S)
        if self._process.is_running:
            self._log.error('the monitor did not end in time and was killed')
            self._process.kill()
        self._process.close()
        if self._listener is not None:
            self._listener.close()


def _line(said: Configured | Report | Answer) -> bytes:
    return msgspec.json.encode(said) + b'\n'
