"""How long rows have waited, though the clock of the machine is set meanwhile."""

import time
from collections.abc import Iterator
from typing import Final, NamedTuple

_S_NS: Final = 1_000_000_000
_STEP_NS: Final = _S_NS  # less than this is no step: a clock that is steered, not set


class _Stretch(NamedTuple):
    """Rows that were written by the same clock.

    Args:
        first: Number of the first.
        ahead_ns: How far that clock was ahead of the one since boot.
    """

    first: int
    ahead_ns: int


class Ages:
    """Judges rows by the clock that they were written by; it goes on though it was set since.

    A row holds the time of the machine, as only that has a meaning in the next life. A robot
    without a battery for its clock begins in 1970, and is set when the network comes, and with it
    Kafka: just when its rows are to be sent, they would all be 50 years old. Rows of an earlier
    life are judged by the clock with which this one begins.
    """

    def __init__(self) -> None:
        self._stretches = [_Stretch(0, _ahead_ns())]

    def note(self, number: int) -> None:
        """Note the first of rows that are made just now."""
        ahead_ns = _ahead_ns()
        if abs(ahead_ns - self._stretches[-1].ahead_ns) > _STEP_NS:
            self._stretches.append(_Stretch(number, ahead_ns))

    def age_s(self, number: int, taken_ns: int) -> float:
        """How long a row has waited."""
        ahead_ns = next(it.ahead_ns for it in reversed(self._stretches) if it.first <= number)
        return (_since_boot_ns() + ahead_ns - taken_ns) / _S_NS

    def older_than(self, age_s: float, end: int) -> Iterator[tuple[int, int]]:
        """Tell, for rows below a number in turn, before when those were taken that are older."""
        limit_ns = _since_boot_ns() - int(age_s * _S_NS)
        ends = [*(it.first for it in self._stretches[1:]), end]
        for before, stretch in zip(ends, self._stretches, strict=True):
            yield before, limit_ns + stretch.ahead_ns


def _ahead_ns() -> int:
    return time.time_ns() - _since_boot_ns()


def _since_boot_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)  # which goes on while the machine sleeps
