"""Which cells there are."""

import math
from collections.abc import Sequence
from typing import Final

from benchmarks.experiment.results import Cell, Load

DEPTHS: Final = (10, 100, 200)
CONTESTANTS: Final = ('paper', 'keep_last', 'bridge', 'bare', 'recording')
SECONDS: Final = 20.0
MOST_ORDERS: Final = 100_000
BURST: Final = 10_000
BURST_EVERY_S: Final = 10.0

# The paper's loads in ten minutes: 5,787, about 51,000 and about 97,000 orders.
LOADS: Final = (
    Load('9.6', '9.6 orders/s', 9.645, of_paper=True),
    Load('86', '86 orders/s', 86.0, of_paper=True),
    Load('160', '160 orders/s', 160.0, of_paper=True),
    Load('1000', '1,000 orders/s', 1000.0),
    Load('5000', '5,000 orders/s', 5000.0),
    Load('20000', '20,000 orders/s', 20_000.0),
    Load('max', 'as fast as possible', 0.0),
    Load('bursts', f'{BURST:,} at once every {BURST_EVERY_S:.0f} s', BURST / BURST_EVERY_S, BURST),
)

_BY_DEPTH: Final = frozenset({'paper', 'keep_last'})
# Of a cell beside its sending: to start and stand idle, to let the last order through, to end; and
# what the slowest contestants take longer than the orders are sent.
_AROUND_S: Final = 8.0
_SLOWEST_PER_S: Final = 8000.0


def cells(
    loads: Sequence[Load], contestants: Sequence[str], depths: Sequence[int], seconds: float
) -> list[Cell]:
    """Make the grid; the contestants of a load come one after the other, to be compared."""
    return [
        Cell(contestant, depth, load, seconds)
        for load in loads
        for contestant in contestants
        for depth in (depths if contestant in _BY_DEPTH else (None,))
    ]


def orders_of(load: Load, seconds: float, most: int) -> int:
    """How many orders are sent: as many as fit into the time, and not more than `most`."""
    if not load.rate:
        return most
    if load.burst > 1:
        bursts = max(1, math.floor(seconds * load.rate / load.burst))
        return min(most, bursts * load.burst)
    return min(most, max(1, round(load.rate * seconds)))


def expected_s(cell: Cell, most: int) -> float:
    """How long a cell will take, about."""
    count = orders_of(cell.load, cell.seconds, most)
    sending_s = (count - cell.load.burst) / cell.load.rate if cell.load.rate else 0.0
    return _AROUND_S + max(sending_s, count / _SLOWEST_PER_S)
