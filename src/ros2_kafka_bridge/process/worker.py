"""A process that runs routes, without the libraries of the command line and of a configuration.

    python -m ros2_kafka_bridge.process.worker --plan FD [--routes a,b] [--snapshots FD] FILE

`process.start` has read FILE: the plan says what it holds.

With `--snapshots` it writes a line of JSON to that file descriptor each second, and a last one
after the drain; `from_line` of `route.counters` reads it. A reader that is slow misses some, one
that is gone gets no more: neither holds the worker up.
"""

import argparse
import contextlib
import faulthandler
import gc
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn, Self

from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.lines import LineWriter
from ros2_kafka_bridge.process.orders import follow_orders
from ros2_kafka_bridge.process.plan import read_plan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import Event
from ros2_kafka_bridge.route.counters import Snapshot, to_line
from ros2_kafka_bridge.threads import unattended
from ros2_kafka_bridge.threads.stop import SIGNALS

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Tell

_PERIOD_S: Final = 1.0
_LAST_S: Final = 1.0
_BUSY_S: Final = 0.01


class SnapshotSender:
    """Sends snapshots once a second, from a thread, and a last time at the end of `with`.

    A lock keeps the lines whole: a route may send one from its own thread.

    Args:
        pipe: Where they go.
        snapshots: Makes them.
        events: Whether what happens is sent, too.
    """

    def __init__(
        self, pipe: int, snapshots: Callable[[], list[Snapshot]], *, events: bool = False
    ) -> None:
        self._snapshots = snapshots
        self._events = events
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send_often, name='snapshots', daemon=True)
        self._lock = threading.Lock()
        self._writer = LineWriter(pipe)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_LAST_S)
        deadline_s = time.monotonic() + _LAST_S
        self._tell(to_line(self._snapshots()))
        while self._writer.unsent and time.monotonic() < deadline_s:
            time.sleep(_BUSY_S)
            self._tell(b'')

    def send(self, event: Event) -> None:
        """Send what cannot wait, and the snapshots of that moment before it.

        A pipe without room gets it in time.
        """
        self._tell(to_line(self._snapshots()) + (wire.to_line(event) if self._events else b''))

    def _send_often(self) -> None:
        while not self._ended.wait(_PERIOD_S):
            self._tell(b'')
            if not self._writer.unsent:  # a slow reader misses some
                self._tell(to_line(self._snapshots()))

    def _tell(self, lines: bytes) -> None:
        with self._lock:
            self._writer.send(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a worker to its end; returns the exit status."""
    faulthandler.enable()  # a crash in a library names the place, in the log of whoever started us
    options = _parse(arguments)
    signals = _before_the_start(options)
    try:
        return _run(options, signals)
    except BridgeError as error:  # only the start raises one: a route keeps its own
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user, as from the command line)
        # What goes by itself, as a full disk, is tried again.
        return 1 if isinstance(error, TransportError) else 2


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m ros2_kafka_bridge.process.worker',
        description='Runs routes in this process.',
    )
    parser.add_argument('file', type=Path, help='configuration, for those who list processes')
    parser.add_argument('--plan', type=int, required=True, metavar='FD', help='what it holds')
    parser.add_argument('--routes', default='', help='names with commas (default: all)')
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--snapshots', type=int, metavar='FD', help='where snapshots go')
    parser.add_argument(
        '--worker', type=int, default=0, metavar='N',
        help='number of this worker; the supervisor speaks to it by standard input',
    )  # fmt: skip
    parser.add_argument(
        '--after', type=int, metavar='FD',
        help='a pipe whose end is waited for before a drain that no supervisor has asked for',
    )  # fmt: skip
    parser.add_argument('--terminal', action='store_true', help='there was one at the start')
    parser.add_argument('--paused', default='', help='names of routes that begin paused')
    parser.add_argument(
        '--waits', action='store_true', help='load everything, and wait to be told to begin'
    )
    return parser.parse_args(arguments)


def _before_the_start(options: argparse.Namespace) -> Signals:
    """Handle the signals, which whoever started this process may have held back."""
    signals = Signals(_end, had_terminal=options.terminal)
    if options.worker:
        for number in SIGNALS:
            # A supervisor passes them on in the right order; Ctrl-C and systemd send them to all.
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    else:
        signals.install()
    return signals


def _end(_number: int) -> NoReturn:
    # No exception: it may come in the middle of a library that passes over it.
    os._exit(0)


# Run


def _run(options: argparse.Namespace, signals: Signals) -> int:
    from ros2_kafka_bridge.bridge import Bridge  # noqa: PLC0415 (heavy: a stop is heard meanwhile)

    plan = read_plan(options.plan)
    os.close(options.plan)
    logs.set_up(options.log_format, options.worker)
    routes = frozenset(_names(options.routes) or plan.names)
    bridge = Bridge(plan.config, routes, options.worker, frozenset(_names(options.paused)))
    # The windows hold thousands of live entries: by default they are walked all the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    with ExitStack() as stack:
        tell: Tell = _tell_nobody
        if options.snapshots is not None:
            sender = SnapshotSender(options.snapshots, bridge.snapshots, events=options.worker > 0)
            tell = stack.enter_context(sender).send
        if options.worker:
            orders = (bridge, options.after)
            threading.Thread(target=follow_orders, args=orders, daemon=True).start()
            return bridge.run(tell, waits=options.waits)

        from ros2_kafka_bridge.process.single_process import run_in_process  # noqa: PLC0415 (not for workers)

        return run_in_process(bridge, plan, signals, options.log_format, tell)


def _tell_nobody(_event: Event) -> None:
    pass


def _names(words: str) -> list[str]:
    return [name.strip() for name in words.split(',') if name.strip()]


def _leave(status: int) -> NoReturn:
    """End the process, also where a thread is left that still waits for Kafka."""
    if unattended.is_any_left():
        logging.shutdown()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):  # nobody reads it any more
                stream.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == '__main__':
    _leave(main())
