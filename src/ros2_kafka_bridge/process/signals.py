"""What SIGHUP means: its terminal was closed, or somebody asks for a reload."""

import os
import signal
import time
from collections.abc import Callable
from typing import Any, Final

from ros2_kafka_bridge.threads.stop import SIGNALS, signals_to_handle
from ros2_kafka_bridge.threads.wakeup import Wakeup

_SOON_S: Final = 10.0
_LOOK_S: Final = 0.5


def _do_nothing(_number: int) -> None:
    pass


class Signals:
    """The signals of a bridge, also those that were held back until they are handled.

    SIGINT and SIGTERM ask for a stop. So does SIGHUP of a closed terminal: that one is gone by
    then, or soon after, where a shell tells its programs before it ends itself. Any other SIGHUP
    asks for a reload.

    Args:
        on_stop: Called with the number of a signal that asks for a stop; may be changed later.
        had_terminal: Whether this process is known to have had one before.
    """

    def __init__(
        self, on_stop: Callable[[int], None] = _do_nothing, *, had_terminal: bool = False
    ) -> None:
        self.on_stop = on_stop
        self.wakeup = Wakeup()  # rung by each signal
        self._asked = False
        self.had_terminal = had_terminal or _has_terminal()
        self._hung_up_s = self._look_at_s = -_SOON_S
        self._gone_s: float | None = None

    def install(self) -> None:
        """Handle them from now on; called by the main thread."""
        for number in signals_to_handle():
            signal.signal(number, self._on_signal)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def take_reload(self) -> bool:
        """Whether a reload was asked for since this was asked last."""
        asked, self._asked = self._asked, False
        return asked

    def check_terminal(self) -> None:
        """Look whether the terminal has gone after all."""
        now_s = time.monotonic()
        if self.had_terminal and now_s >= self._look_at_s:
            self._look_at_s = now_s + _LOOK_S
            if self._has_just_gone(now_s) and now_s - self._hung_up_s < _SOON_S:
                self.had_terminal = False
                self.on_stop(signal.SIGHUP)

    def _on_signal(self, number: int, _frame: Any) -> None:
        self._take(number)
        self.wakeup.ring()

    def _take(self, number: int) -> None:
        if number != signal.SIGHUP:
            self.on_stop(number)
            return
        self._hung_up_s = time.monotonic()
        if self._has_just_gone(self._hung_up_s):
            self.on_stop(number)
        else:
            self._asked = True

    def _has_just_gone(self, now_s: float) -> bool:
        """Whether the terminal has gone, and not long ago: who outlives it may be reloaded."""
        if not self.had_terminal or _has_terminal():
            return False
        self._gone_s = self._gone_s or now_s
        return now_s - self._gone_s < _SOON_S


def _has_terminal() -> bool:
    try:
        os.close(os.open('/dev/tty', os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True
