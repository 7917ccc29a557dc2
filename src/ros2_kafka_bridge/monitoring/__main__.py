"""The process that shows a bridge: metrics, health and the page over HTTP, and its ROS node.

    python -m ros2_kafka_bridge.monitoring [--log-format text|json] [--socket FD] --requests FD

It carries no message. The supervisor tells it by standard input how the bridge is doing, reads
from the other descriptor what is asked for, and ends it by closing the input: see
`protocol/monitor.py`.
"""

import argparse
import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.logs.handler import THREAD
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.outside.extras import missing_extra
from ros2_kafka_bridge.threads.stop import SIGNALS, Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.monitoring.server import Server

_CLOSING_S: Final = 4.0  # the supervisor gives five
_AGAIN_S: Final = 10.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Show the bridge until the supervisor closes the input; returns the exit status."""
    options = _parse(arguments)
    for number in SIGNALS:  # the supervisor handles them
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    logs.set_up(options.log_format)
    try:
        return _Process(Watch(_writer(options.requests))).run(options.socket)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user)
        return 2


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.monitoring')
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument(
        '--requests', type=int, required=True, metavar='FD', help='where requests are written'
    )
    parser.add_argument('--socket', type=int, metavar='FD', help='a socket that listens')
    return parser.parse_args(arguments)


def _writer(pipe: int) -> Callable[[bytes], None]:
    """What writes to the supervisor."""

    def write(line: bytes) -> None:
        while line:
            line = line[os.write(pipe, line) :]

    return write


class _Process:
    """The threads of this process, and its end: of the input, or of a thread that met a bug."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._stop = Stop()
        self._ended = threading.Event()
        self._configured = threading.Event()
        self._failed = False
        self._threads: list[threading.Thread] = []
        self._log = logs.route_log()

    def run(self, listener: int | None) -> int:
        """Run until the end of the input.

        Raises:
            ConfigError: A library is missing.
        """
        self._start(self._read, 'reports')
        self._configured.wait()
        if self._ended.is_set():
            return int(self._failed)
        server = None if listener is None else self._server(listener)
        if server is not None:
            self._start(server.run, 'web')
        settings = self._watch.config.monitoring
        if settings is None or settings.node:
            self._start(self._control, 'ros')
        self._ended.wait()
        self._close(server)
        return int(self._failed)

    def _start(self, work: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=self._watched, args=(work,), name=name, daemon=True)
        thread.start()
        if work != self._read:
            self._threads.append(thread)

    def _watched(self, work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException:
            self._fail()
            raise

    def _fail(self) -> None:
        self._failed = True
        self._ended.set()
        self._configured.set()

    def _read(self) -> None:
        # Not through sys.stdin: its lock, held here, would break the end of the interpreter.
        with open(sys.stdin.fileno(), 'rb', closefd=False) as lines:
            for line in lines:
                self._on_line(line)
        self._watch.close()
        self._ended.set()
        self._configured.set()

    def _on_line(self, line: bytes) -> None:
        try:
            self._watch.on_line(line)
        except ValueError as error:
            self._log.error('the page could not read what the supervisor told: %s', error)
        if self._watch.is_configured:
            self._configured.set()

    def _server(self, listener: int) -> 'Server':
        try:
            from ros2_kafka_bridge.monitoring.server import Server  # noqa: PLC0415 (an extra)
        except ModuleNotFoundError as error:
            problem = missing_extra('monitoring') or f'monitoring cannot be loaded: {error}'
            raise ConfigError([problem]) from error
        return Server(self._watch, socket.socket(fileno=listener), self._fail)

    def _control(self) -> None:
        """Run the ROS node of the bridge; without ROS, the rest goes on."""
        from ros2_kafka_bridge.ros.control.node import run_control  # noqa: PLC0415 (heavy)

        while not self._stop.asked:
            try:
                run_control(self._watch, self._stop)
            except BridgeError as error:
                self._log.error('the ROS node of the bridge: %s; tried again', error)
                self._stop.wait(_AGAIN_S)

    def _close(self, server: 'Server | None') -> None:
        self._stop.ask()
        if server is not None:
            server.stop()
        deadline_s = time.monotonic() + _CLOSING_S
        for thread in self._threads:
            thread.join(max(0.0, deadline_s - time.monotonic()))
        if any(thread.name not in {'MainThread', THREAD} for thread in threading.enumerate()):
            # One that still asks Kafka or ROS would meet an interpreter that is being taken down.
            logging.shutdown()
            os._exit(int(self._failed))


if __name__ == '__main__':
    sys.exit(main())
