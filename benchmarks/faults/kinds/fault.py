"""What a kind of fault is, and what several of them have in common."""

import time
from collections.abc import Callable
from typing import Final, NamedTuple

from benchmarks.faults.checker import Allowance
from benchmarks.faults.streams import Stream
from benchmarks.faults.world import World

LEASE_S: Final = 20.0
"""How long DDS waits for a silent participant before it is gone, by default."""

BROKER_S: Final = 5.0
"""Longest time until all flows again, once a broker is back."""

BRIDGE_S: Final = 10.0
"""The same of a bridge, or of whoever takes over."""

NOTHING: Final = Allowance()
REPEATS: Final = Allowance(duplicated=True)


class Fault(NamedTuple):
    """A kind of fault.

    Args:
        name: For the command line.
        words: For the table.
        hold_s: Between breaking and mending, shortest and longest.
        inject: Breaks it; the number chooses among several.
        recover: Mends it; returns when it was back, in nanoseconds since 1970, None where
            nothing was gone.
        allows: What it may cost a stream.
        aims_at: The one stream that it is aimed at; None where it concerns all.
        after_s: How long it goes on having effects.
        by_another: Whether another takes over, so that the time to recover counts from the
            breaking.
        required_s: Longest time to recover; None where nothing is required.
        keeps_spool: Whether who is broken keeps a spool that another would take over with the
            route: until it is mended, nothing is required of that stream.
        seconds: How long all of it takes, roughly, for the plan.
        needs: What of a run it needs: `cluster`, `hosts`, `disk`, `one bridge`, `two bridges`,
            a stream `to ROS` or `from ROS`.
    """

    name: str
    words: str
    hold_s: tuple[float, float]
    inject: Callable[[World, int], object]
    recover: Callable[[World, int], int | None]
    allows: Callable[[Stream, float], Allowance]
    aims_at: Callable[[World, int], str] | None = None
    after_s: float = 0.0
    by_another: bool = False
    required_s: float | None = None
    keeps_spool: bool = False
    seconds: float = 15.0
    needs: str = ''

    def limit_s(self, stream: Stream) -> float | None:
        """Longest time until a stream may flow again; None where nothing is required."""
        return None if self.keeps_spool and stream.spool is not None else self.required_s


def costs_nothing(_stream: Stream, _hold_s: float) -> Allowance:
    """It may neither lose nor repeat."""
    return NOTHING


def repeats_from_kafka(stream: Stream, _hold_s: float) -> Allowance:
    """A hand-over of partitions may repeat what is in flight."""
    return REPEATS if stream.is_from_kafka else NOTHING


def back_as_it_begins(mend: Callable[[World, int], object]) -> Callable[[World, int], int]:
    """A recovery after which all is there from its first moment on."""

    def recover(world: World, target: int) -> int:
        back_ns = time.time_ns()
        mend(world, target)
        return back_ns

    return recover
