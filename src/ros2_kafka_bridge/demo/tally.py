"""What came out of the orders that went in."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

# An order that a later one has overtaken may still be on its way: through another partition, or
# to be published again after a reader went away.
OVERDUE_S: Final = 1.0


class Arrival(NamedTuple):
    """An order that came back.

    Args:
        at_s: When, since the first order was sent.
        latency_s: Since this order was made.
    """

    order_id: int
    at_s: float
    latency_s: float


class Latency(NamedTuple):
    """How long orders took from their making to their return, in seconds."""

    fastest: float
    median: float
    percentile_99: float
    slowest: float


class Tally:
    """Counts arrivals; orders are numbered from 0."""

    def __init__(self) -> None:
        self.duplicated = 0
        self._seen: set[int] = set()
        self._missing: dict[int, float] = {}  # since when, in seconds
        self._next = 0
        self._latencies_s: list[float] = []
        self._per_second: list[int] = []
        self._first_s = math.inf

    def add(self, arrivals: Sequence[Arrival]) -> None:
        """Count what has arrived."""
        for arrival in arrivals:
            self._place(arrival)
            self._count_second(arrival.at_s)
        self._latencies_s += [arrival.latency_s for arrival in arrivals]
        self._latencies_s.sort()  # the old ones are in order: as quick as a merge

    @property
    def consumed(self) -> int:
        """Different orders that arrived."""
        return len(self._seen)

    def overdue(self, now_s: float) -> int:
        """Orders that later ones have overtaken, more than a second ago."""
        return sum(now_s - since_s > OVERDUE_S for since_s in self._missing.values())

    def lost(self, produced: int) -> int:
        """Of `produced` orders, those that never arrived."""
        return max(0, produced - self.consumed)

    def latency(self) -> Latency | None:
        """How long they took; None while there are none."""
        times = self._latencies_s
        if not times:
            return None
        return Latency(times[0], percentile(times, 50), percentile(times, 99), times[-1])

    def rates(self, now_s: float | None = None) -> Sequence[int]:
        """Arrivals in each second since the first: those that have passed, without a time all."""
        if now_s is None:
            return self._per_second
        whole = max(0, int(now_s - self._first_s)) if self._per_second else 0
        return (self._per_second + [0] * whole)[:whole]

    def _place(self, arrival: Arrival) -> None:
        order_id = arrival.order_id
        if order_id in self._seen:
            self.duplicated += 1
            return
        self._seen.add(order_id)
        self._missing.pop(order_id, None)
        self._missing |= dict.fromkeys(range(self._next, order_id), arrival.at_s)
        self._next = max(self._next, order_id + 1)

    def _count_second(self, at_s: float) -> None:
        self._first_s = min(self._first_s, at_s)
        second = int(at_s - self._first_s)
        self._per_second += [0] * (second + 1 - len(self._per_second))
        self._per_second[second] += 1


def percentile(ordered: Sequence[float], percent: float) -> float:
    """The smallest value that at least `percent` of all do not exceed (nearest rank)."""
    return ordered[max(1, math.ceil(len(ordered) * percent / 100)) - 1]
