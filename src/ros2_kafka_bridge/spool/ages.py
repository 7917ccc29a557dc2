"""How long rows have waited, though the clock of the machine is set meanwhile."""

import time
from collections.abc import Iterator
from typing import Final, NamedTuple

from ros2_kafka_bridge.route.clock import RELEASED_NS, since_boot_ns

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


class Older(NamedTuple):
    """Which rows are older than an age; times are those in the rows, since 1970.

    Args:
        below: Of those with lower numbers.
        since_ns: What was taken before has an unknown age, and is not.
        until_ns: What was taken later is not.
    """

    below: int
    since_ns: int
    until_ns: int


class Ages:
    """Judges rows by the clock that they were written by; it goes on though it was set since.

    A row holds the time of the machine, as only that has a meaning in the next life. A robot
    without a battery for its clock begins in 1970, and is set when the network comes, and with it
    Kafka: just when its rows are to be sent, they would all be 50 years old. Rows of an earlier
    life are judged by the clock with which this one begins; where theirs was not set, nobody knows
    when they were taken, and they wait from the beginning of this life on.
    """

    def __init__(self) -> None:
        self._began_ns = since_boot_ns()
        self._stretches = [_Stretch(0, _ahead_ns())]

    def note(self, number: int) -> None:
        """Note the first of rows that are made just now."""
        ahead_ns = _ahead_ns()
        if abs(ahead_ns - self._stretches[-1].ahead_ns) > _STEP_NS:
            self._stretches.append(_Stretch(number, ahead_ns))

    def age_s(self, number: int, taken_ns: int) -> float:
        """How long a row has waited."""
        stretch = next(it for it in reversed(self._stretches) if it.first <= number)
        waited_ns = since_boot_ns() + stretch.ahead_ns - taken_ns
        if taken_ns < RELEASED_NS:
            waited_ns = min(waited_ns, since_boot_ns() - self._began_ns)
        return waited_ns / _S_NS

    def older_than(self, age_s: float, end: int) -> Iterator[Older]:
        """Tell, for rows below a number in turn, when those were taken that are older."""
        limit_ns = since_boot_ns() - int(age_s * _S_NS)
        ends = [*(it.first for it in self._stretches[1:]), end]
        since_ns = 0 if self._began_ns < limit_ns else RELEASED_NS
        for before, stretch in zip(ends, self._stretches, strict=True):
            yield Older(before, since_ns, limit_ns + stretch.ahead_ns)
            since_ns = 0  # whatever the clock showed in this life: how long they waited is known


def _ahead_ns() -> int:
    return time.time_ns() - since_boot_ns()
