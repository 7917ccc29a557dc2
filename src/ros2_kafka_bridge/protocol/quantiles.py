"""Quantiles of what was measured between two moments."""

from collections.abc import Sequence
from itertools import pairwise

from ros2_kafka_bridge.route.counters import BOUNDS_S, Distribution


def percentiles(now: Distribution, then: Distribution) -> tuple[float, float] | None:
    """The 50th and 99th of what came between, in seconds; the last bucket has its lower bound.

    None where nothing came. A process that was started again counts from zero: then all of `now`
    came between.
    """
    counts = [later - earlier for later, earlier in zip(now.counts, then.counts, strict=True)]
    if min(counts) < 0:
        counts = list(now.counts)
    total = sum(counts)
    return (_quantile(counts, 0.5 * total), _quantile(counts, 0.99 * total)) if total else None


def _quantile(counts: Sequence[int], rank: float) -> float:
    """Where a rank lies, between the bounds of its bucket as if these were filled evenly."""
    below = 0
    for count, (low, high) in zip(counts, pairwise((0.0, *BOUNDS_S)), strict=False):
        if count and below + count >= rank:
            return low + (high - low) * (rank - below) / count
        below += count
    return BOUNDS_S[-1]
