"""How a running bridge is told to stop."""

import os
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from ros2_kafka_bridge.threads.wakeup import Wakeup

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stop:
    """Two steps: drain first, at once then. Asked for by a signal handler, read by every route.

    Plain attributes, no lock: a signal handler that interrupts the holder of a lock would wait
    for ever.

    Args:
        wakeup: Ends the waits of the thread that is to stop.
    """

    def __init__(self, wakeup: Wakeup | None = None) -> None:
        self.wakeup = wakeup or Wakeup()
        self._drain = False
        self._limit = False
        self._now = False
        self._parts: tuple[Wakeup, ...] = ()

    def ask(self, *, limited: bool = True) -> None:
        """Ask for a drain; asked a second time, for an end at once.

        Args:
            limited: Whether the drain has a limit (`drain_s`): somebody waits for its end. Asked
                without, it does not count as the first time.
        """
        self._now = self._now or (self._limit and limited)
        self._limit = self._limit or limited
        self._drain = True
        for wakeup in (self.wakeup, *self._parts):
            wakeup.ring()

    def wake_also(self, part: Wakeup) -> None:
        """Note what else ends the waits of those who are to stop."""
        self._parts = (*self._parts, part)

    def on_signal(self, number: int, _frame: Any = None) -> None:
        """Ask, as the handler of a signal."""
        if number == signal.SIGHUP:
            _let_go_of_closed_terminal()
            # One closed terminal sends it twice: the shell does, and the kernel when that ends.
            if self._drain:
                return
        self.ask()

    @property
    def asked(self) -> bool:
        """Whether to drain."""
        return self._drain

    @property
    def is_limited(self) -> bool:
        """Whether that has a limit."""
        return self._limit

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight."""
        return self._now

    def wait(self, timeout_s: float) -> bool:
        """Wait until a drain is asked for, at most `timeout_s`; tells whether it was."""
        deadline_s = time.monotonic() + timeout_s
        while not self.asked and (left_s := deadline_s - time.monotonic()) > 0:
            self.wait_for_any(left_s)
        return self.asked

    def wait_for_any(self, timeout_s: float) -> None:
        """Wait until a drain is asked for, or the wakeup was rung for anything else."""
        if self.wakeup.wait(timeout_s) and not self.asked:
            self.wakeup.clear()
            if self.asked:  # in between: another that waits for this stop needs it
                self.wakeup.ring()


class Part(Stop):
    """The stop of one route: its own, or that of all.

    Args:
        whole: That of all.
    """

    def __init__(self, whole: Stop) -> None:
        super().__init__()
        self._whole = whole
        whole.wake_also(self.wakeup)

    @property
    def asked(self) -> bool:
        """Whether to drain."""
        return self._drain or self._whole.asked

    @property
    def is_limited(self) -> bool:
        """Whether that has a limit."""
        return self._limit or self._whole.is_limited

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight."""
        return self._now or self._whole.at_once


@contextmanager
def ctrl_c_asks(stop: Stop) -> Iterator[None]:
    """Let Ctrl-C ask for a stop, and raise its exception behind the block, as `asyncio.run` does.

    In the middle of a drain the exception would break it off. In another thread, and where the
    program has a handler of its own, nothing is changed.

    Raises:
        KeyboardInterrupt: It came.
    """
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    came: list[int] = []

    def ask(number: int, _frame: Any) -> None:
        came.append(number)
        stop.ask()

    signal.signal(signal.SIGINT, ask)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if came:
        raise KeyboardInterrupt


@contextmanager
def handling(on_signal: Callable[[int, Any], None]) -> Iterator[None]:
    """Let a handler have the signals that ask this process to stop, for as long as it lasts."""
    before = {number: signal.signal(number, on_signal) for number in signals_to_handle()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def signals_to_handle() -> Sequence[signal.Signals]:
    """The signals that ask this process to stop: not SIGHUP where `nohup` has it ignored."""
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return [number for number in SIGNALS if number != signal.SIGHUP]
    return SIGNALS


def _let_go_of_closed_terminal() -> None:
    """Print to nobody from now on: a terminal that is gone refuses every line with an error."""
    for descriptor in (1, 2):
        try:
            mode = os.fstat(descriptor).st_mode
        except OSError:  # closed long ago
            continue
        if stat.S_ISCHR(mode) and not os.isatty(descriptor):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, descriptor)
            os.close(null)
