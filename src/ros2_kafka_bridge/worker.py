"""A process that runs routes, without the libraries of the command line.

    python -m ros2_kafka_bridge.worker FILE [--routes a,b] [--snapshots FD] [--content FD]

With `--snapshots` it writes a line of JSON to that file descriptor each second, and a last one
after the drain; `metrics.from_line` reads it. A reader that is slow misses some, one that is gone
gets no more: neither holds the worker up. With `--content` the configuration is what that file
descriptor holds: FILE gives its name to the messages, and its directory to `${file:PATH}`.
"""

import argparse
import contextlib
import gc
import os
import resource
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn, Self

from ros2_kafka_bridge import logs
from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.metrics import Snapshot, to_line
from ros2_kafka_bridge.stop import SIGNALS, signals_to_heed

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge
    from ros2_kafka_bridge.config.settings import Config

_PERIOD_S: Final = 1.0
_LAST_S: Final = 1.0
_BUSY_S: Final = 0.01
_OPEN_FILES: Final = 65_536


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a worker to its end; returns the exit status."""
    options = _parse(arguments)
    _before_the_start(supervised=options.worker > 0)
    allow_open_files()
    try:
        return _run(options)
    except BridgeError as error:  # only the start raises one: a route keeps its own
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user, as from the command line)
        return 2


def allow_open_files() -> None:
    """Raise the limit of open files as far as this user may, as a route needs seven or so.

    Systems begin with a low one, for programs that cannot count further than 1024.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def load_checked(file: Path, text: str | None = None) -> 'Config':
    """The configuration in a file, checked against the types and the Kafka client found here.

    Args:
        file: The file.
        text: What it held when it was read; None reads it now.

    Raises:
        ConfigError: With every mistake in the file.
    """
    from ros2_kafka_bridge.config.file import load, loads  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.kafka.properties import property_problems  # noqa: PLC0415
    from ros2_kafka_bridge.ros.types import unknown_type  # noqa: PLC0415

    if text is not None:
        return loads(text, str(file), os.environ, unknown_type, property_problems)
    return load(file, os.environ, unknown_type, property_problems)


def chosen(config: 'Config', routes: str) -> frozenset[str] | None:
    """The names in a list with commas, None for all routes.

    Raises:
        ConfigError: There are no such routes.
    """
    if not routes:
        return None
    names = frozenset(name.strip() for name in routes.split(','))
    known = {route.name for route in config.routes}
    if unknown := sorted(names - known):
        there = ', '.join(sorted(known))
        raise ConfigError([f'--routes: no route {name}, there are {there}' for name in unknown])
    return names


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m ros2_kafka_bridge.worker', description='Runs routes in this process.'
    )
    parser.add_argument('file', type=Path, help='configuration (YAML)')
    parser.add_argument('--routes', default='', help='names with commas (default: all)')
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--snapshots', type=int, metavar='FD', help='where snapshots go')
    parser.add_argument(
        '--worker', type=int, default=0, metavar='N',
        help='number of this worker; the supervisor speaks to it by standard input',
    )  # fmt: skip
    parser.add_argument('--content', type=int, metavar='FD', help='what FILE held, UTF-8')
    parser.add_argument(
        '--after', type=int, metavar='FD',
        help='a pipe whose end is waited for before a drain that no supervisor has asked for',
    )  # fmt: skip
    return parser.parse_args(arguments)


def _before_the_start(*, supervised: bool) -> None:
    """Take over the signals, which whoever started this process may have held back."""
    for number in SIGNALS if supervised else signals_to_heed():
        # A supervisor passes them on in the right order; Ctrl-C and systemd send them to all.
        signal.signal(number, signal.SIG_IGN if supervised else _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _end(_number: int, _frame: Any) -> NoReturn:
    raise SystemExit(0)


# Run


def _run(options: argparse.Namespace) -> int:
    text = None if options.content is None else _content(options.content)
    config = load_checked(options.file, text)
    routes = chosen(config, options.routes)

    from ros2_kafka_bridge.bridge import Bridge  # noqa: PLC0415 (heavy: only for a right file)

    logs.set_up(options.log_format)
    bridge = Bridge(config, routes, options.worker)
    if options.worker:
        threading.Thread(target=_obey, args=(bridge, options.after), daemon=True).start()
    else:
        for number in signals_to_heed():
            signal.signal(number, bridge.stop.on_signal)
    # The windows hold thousands of live entries: by default they are walked all the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    if options.snapshots is None:
        return bridge.run()
    with _Sender(options.snapshots, bridge.snapshots) as sender:
        return bridge.run(sender.send_now)


def _content(descriptor: int) -> str:
    """All that an inherited file holds, wherever another reader of it has come to."""
    return os.pread(descriptor, os.fstat(descriptor).st_size, 0).decode()


def _obey(bridge: 'Bridge', after: int | None) -> None:
    """Pass on what the supervisor asks for; without a supervisor, drain in the same order."""
    while os.read(sys.stdin.fileno(), 1):
        bridge.stop.ask()
    if after is not None:
        os.read(after, 1)  # until the workers that publish to ROS have ended
    if not bridge.stop.asked:
        logs.route_log().error('the supervisor has gone: draining')
        bridge.stop.ask()


class _Sender:
    """Sends snapshots once a second, from a thread, and a last time at the end of `with`.

    A lock keeps the lines whole: a route may send one from its own thread.
    """

    def __init__(self, pipe: int, snapshots: Callable[[], list[Snapshot]]) -> None:
        self._pipe = pipe
        self._snapshots = snapshots
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send_often, name='snapshots', daemon=True)
        self._lock = threading.Lock()
        self._rest = b''

    def __enter__(self) -> Self:
        mode = os.fstat(self._pipe).st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):  # a terminal is shared with others
            os.set_blocking(self._pipe, False)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_LAST_S)
        with contextlib.suppress(OSError):
            self._send_last()

    def send_now(self) -> None:
        """Send what cannot wait; a pipe without room gets it in time."""
        with contextlib.suppress(OSError), self._lock:
            line = to_line(self._snapshots())
            if self._send(line):  # the rest of another came first
                self._send(line)

    def _send_often(self) -> None:
        with contextlib.suppress(OSError):  # nobody reads any more
            while not self._ended.wait(_PERIOD_S):
                with self._lock:
                    self._send(to_line(self._snapshots()))

    def _send_last(self) -> None:
        deadline_s = time.monotonic() + _LAST_S
        line = to_line(self._snapshots())
        while time.monotonic() < deadline_s:
            with self._lock:
                line = self._send(line)
                if not line and not self._rest:
                    return
            time.sleep(_BUSY_S)

    def _send(self, line: bytes) -> bytes:
        """Write the line, or first what is left of an older one; returns what was not begun."""
        data = self._rest or line
        try:
            written = os.write(self._pipe, data)
        except BlockingIOError:
            return line
        begun = not self._rest
        self._rest = data[written:]
        return b'' if begun else line


if __name__ == '__main__':
    sys.exit(main())
