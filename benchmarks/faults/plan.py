"""Which faults a run injects: when, which, at what. All of it comes from a seed."""

import random
from collections.abc import Sequence
from typing import Final

import msgspec

from benchmarks.faults.kinds.fault import Fault

_WAIT_S: Final = (2.0, 6.0)


class Step(msgspec.Struct, frozen=True):
    """One fault of a plan.

    Args:
        wait_s: From when all was well after the one before.
        hold_s: Between breaking and mending.
        target: Chooses among several that it can be done to.
    """

    fault: str
    wait_s: float
    hold_s: float
    target: int


def make_plan(
    seed: int, faults: Sequence[Fault], minutes: float, times: int | None = None
) -> list[Step]:
    """Draw faults until a time is filled; each kind once before one comes again.

    However short the time is, each comes once.

    Args:
        seed: The same one draws the same plan.
        faults: To draw from.
        minutes: To be filled.
        times: How often each comes, whatever time that takes; None fills the time.
    """
    draw = random.Random(seed)  # noqa: S311 - chance, no secret
    steps: list[Step] = []
    left_s = minutes * 60
    count = len(faults) * (times or 1)
    while (left_s > 0 and times is None) or len(steps) < count:
        for fault in draw.sample(faults, len(faults)):
            if left_s <= 0 and len(steps) >= count:
                break
            step = Step(
                fault.name,
                round(draw.uniform(*_WAIT_S), 1),
                round(draw.uniform(*fault.hold_s), 1),
                draw.randrange(1000),
            )
            steps.append(step)
            left_s -= step.wait_s + fault.seconds
    return steps
