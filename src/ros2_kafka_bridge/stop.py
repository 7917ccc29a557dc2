"""How a running bridge is told to stop."""

import time

_STEP_S = 0.05


class Stop:
    """Two steps: drain first, at once then. Asked for by a signal handler, read by every route.

    Plain attributes, no lock: a signal handler that interrupts the holder of a lock would wait
    for ever.
    """

    def __init__(self) -> None:
        self._drain = False
        self._now = False

    def ask(self) -> None:
        """Ask for a drain; asked a second time, for an end at once."""
        self._now = self._now or self._drain
        self._drain = True

    @property
    def asked(self) -> bool:
        """Whether to drain."""
        return self._drain

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight."""
        return self._now

    def wait(self, timeout_s: float) -> bool:
        """Wait until a stop is asked for, at most `timeout_s`; tells whether it was."""
        deadline_s = time.monotonic() + timeout_s
        while not self._drain and (left_s := deadline_s - time.monotonic()) > 0:
            time.sleep(min(_STEP_S, left_s))
        return self._drain
