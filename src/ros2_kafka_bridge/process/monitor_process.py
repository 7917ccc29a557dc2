"""The process that watches the bridge, as its supervisor sees it.

It holds no route: one that dies is started again, and the routes never notice. What it is told
never holds the supervisor up, either: of the reports only the newest waits for it.
"""

import contextlib
import errno
import os
import selectors
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.child import start_child
from ros2_kafka_bridge.process.plan import OFF
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Report, Request
from ros2_kafka_bridge.threads.backoff import Backoff

_LINE_LIMIT_BYTES: Final = 64 * 1024
_PIPE_BYTES: Final = 65_536
_WAITING: Final = 64
_PATIENCE_S: Final = 60.0
_CLOSING_S: Final = 5.0
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
        end: The socket where it listens; None for none.
        log_format: How it writes a line of the log.
        selector: Where what it says is waited for; its data are called.
        on_request: Called with what it asks for, and what takes the answer.
    """

    def __init__(
        self,
        end: socket.socket | None,
        log_format: str,
        selector: selectors.BaseSelector,
        on_request: Callable[[Request, Callable[[Answer], None]], None],
    ) -> None:
        self._socket = end
        self._log_format = log_format
        self._selector = selector
        self._on_request = on_request
        self._log = logs.route_log()
        self._process: subprocess.Popen[bytes] | None = None
        self._backoff = Backoff()
        self._started_s = self._start_at_s = 0.0
        self._lives = 0
        self._configured: bytes = b''
        self._report = b''
        self._waiting: deque[bytes] = deque()
        self._begun = b''  # the rest of a line
        self._stuck_since_s: float | None = None
        self._heard = b''

    @property
    def pid(self) -> int:
        """The id of the process, 0 where there is none."""
        return 0 if self._process is None else self._process.pid

    # What it is told

    def configure(self, configured: Configured) -> None:
        """Tell which configuration counts, now and at each further start."""
        self._configured = _line(configured)
        if self._process is not None:
            self._waiting.append(self._configured)

    def report(self, report: Report) -> None:
        """Tell how the bridge is doing, in the place of a report that still waits."""
        self._report = _line(report)

    def tick(self) -> None:
        """Start it if it is due, and send what waits for it."""
        if self._process is not None and (status := self._process.poll()) is not None:
            self._ended(status)
        if self._process is None and time.monotonic() >= self._start_at_s:
            self._start()
        if self._process is not None:
            self._send()

    def _send(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None, 'it was started with a pipe'
        while line := self._begun or self._next():
            try:
                written = self._process.stdin.write(line) or 0
            except OSError:  # it has ended: seen at the next look
                return
            self._begun = line[written:]
            if written:
                self._stuck_since_s = None
            if self._begun:
                self._look_whether_stuck()
                return

    def _next(self) -> bytes:
        if self._waiting:
            return self._waiting.popleft()
        line, self._report = self._report, b''
        return line

    def _look_whether_stuck(self) -> None:
        now_s = time.monotonic()
        self._stuck_since_s = self._stuck_since_s or now_s
        if now_s - self._stuck_since_s > _PATIENCE_S and self._process is not None:
            self._log.error('the monitor takes nothing any more: it is killed')
            self._process.kill()

    # Its lives

    def _start(self) -> None:
        self._lives += 1
        self._started_s = time.monotonic()
        self._waiting, self._begun, self._heard = deque([self._configured]), b'', b''
        self._stuck_since_s = None
        kept = [] if self._socket is None else [self._socket.fileno()]
        try:
            self._process = start_child(
                'monitoring', self._options(), kept, stdout=subprocess.PIPE
            )
        except OSError as error:
            self._fail(f'could not be started ({error.strerror})')
            return
        assert self._process.stdin is not None
        assert self._process.stdout is not None, 'it was started with pipes'
        os.set_blocking(self._process.stdin.fileno(), False)
        os.set_blocking(self._process.stdout.fileno(), False)
        self._selector.register(self._process.stdout, selectors.EVENT_READ, self._read)
        self._log.info('the monitor is process %d', self._process.pid)

    def _options(self) -> Sequence[str]:
        words = [f'--log-format={self._log_format}']
        return words if self._socket is None else [*words, f'--socket={self._socket.fileno()}']

    def _ended(self, status: int) -> None:
        self._let_go()
        how = f'status {status}' if status >= 0 else f'signal {-status}'
        self._fail(f'has ended ({how})')

    def _fail(self, how: str) -> None:
        self._backoff = self._backoff.after(time.monotonic() - self._started_s)
        self._start_at_s = time.monotonic() + self._backoff.wait_s
        self._log.error(
            'the monitor %s: started again in %.0f s; the routes go on', how, self._backoff.wait_s
        )

    def _let_go(self) -> None:
        assert self._process is not None
        process, self._process = self._process, None
        if process.stdout is not None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(process.stdout)
            process.stdout.close()
        if process.stdin is not None:
            process.stdin.close()

    # What it asks for

    def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        data = self._process.stdout.read(_PIPE_BYTES)
        if data == b'':
            self._selector.unregister(self._process.stdout)
            return
        *lines, rest = (self._heard + (data or b'')).split(b'\n')
        self._heard = rest if len(rest) <= _LINE_LIMIT_BYTES else b''
        for line in lines:
            with contextlib.suppress(ValueError):
                self._on_request(_REQUESTS.decode(line), self._answerer())

    def _answerer(self) -> Callable[[Answer], None]:
        """What takes an answer to a request of this life of the process."""
        life = self._lives

        def answer(answer: Answer) -> None:
            if life == self._lives and self._process is not None and self._room:
                self._waiting.append(_line(answer))

        return answer

    @property
    def _room(self) -> bool:
        return len(self._waiting) < _WAITING

    # Its end

    def close(self) -> None:
        """Let it say the last report, and end; one that does not is killed."""
        if self._process is not None:
            deadline_s = time.monotonic() + _CLOSING_S
            stdin = self._process.stdin
            while (self._begun or self._waiting or self._report) and self._is_in(deadline_s):
                self._send()
                time.sleep(0.01)
            if stdin is not None:
                stdin.close()
            try:
                self._process.wait(max(0.1, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                self._log.error('the monitor did not end in time and was killed')
                self._process.kill()
                self._process.wait()
            self._let_go()
        if self._socket is not None:
            self._socket.close()

    def _is_in(self, deadline_s: float) -> bool:
        assert self._process is not None
        return self._process.poll() is None and time.monotonic() < deadline_s


def _line(said: Configured | Report | Answer) -> bytes:
    return msgspec.json.encode(said) + b'\n'
