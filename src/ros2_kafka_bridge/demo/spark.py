"""A line of bars, for a table."""

from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean
from typing import Final

BARS: Final = '▁▂▃▄▅▆▇█'


def spark(values: Sequence[float], width: int) -> str:
    """Draw values as bars between 0 and the highest of them, at most `width` of them.

    More values than that are drawn as the means of neighbours.
    """
    if not values:
        return ''
    count = min(width, len(values))
    edges = [len(values) * number // count for number in range(count + 1)]
    means = [fmean(values[start:end]) for start, end in pairwise(edges)]
    highest = max(means) or 1
    return ''.join(BARS[round(mean / highest * (len(BARS) - 1))] for mean in means)
