"""The goals, and whether they were met."""

from collections.abc import Callable, Sequence
from typing import Any, Final, Literal, NamedTuple

import pandas as pd

from benchmarks.experiment.report.measured import OURS, Measured
from benchmarks.experiment.report.numbers import count, digits

MEDIAN_MS: Final = 2.5
P99_RATIO: Final = 1.2
_ENOUGH: Final = 1000  # orders, below which the 99th percentile rests on a handful

Verdict = Literal['PASS', 'FAIL', 'NOT MEASURED']

_DECISIVE: Final[Sequence[Verdict]] = ('FAIL', 'NOT MEASURED', 'PASS')


class Goal(NamedTuple):
    """One that was set beforehand.

    Args:
        why: The numbers that decide; of a goal that is not met, the cells that fail.
    """

    words: str
    verdict: Verdict
    why: str


class _Look(NamedTuple):
    """At one cell: what it comes to, and the numbers."""

    verdict: Verdict
    words: str


_NOTHING_CAME: Final = _Look('FAIL', 'nothing came')


def goals(measured: Measured) -> Sequence[Goal]:
    """Judge them all."""
    everywhere = measured.at(OURS, list(dict.fromkeys([*measured.of_paper, *measured.loads])))
    at_paper_loads = measured.at(OURS, measured.of_paper)
    return [
        _none(everywhere, 'No order is lost', 'lost'),
        _none(everywhere, 'No order is duplicated', 'duplicated', 'repeated'),
        _none(everywhere, 'No order is out of order', 'out_of_order', 'out of order'),
        _goal(
            f"Median latency at the paper's loads is at most {digits(MEDIAN_MS)} ms",
            _looks(at_paper_loads, _median),
        ),
        _goal(
            f"99th percentile at the paper's loads is at most {digits(P99_RATIO)} times that of "
            'bare loops',
            _looks(at_paper_loads, _against_bare),
        ),
    ]


def _goal(words: str, looks: Sequence[_Look]) -> Goal:
    """Judge by the cells: one that fails decides; all must be there to pass."""
    verdict = min((look.verdict for look in looks), key=_DECISIVE.index)
    return Goal(words, verdict, '; '.join(one.words for one in looks if one.verdict == verdict))


def _looks(cells: pd.DataFrame, judge: Callable[[Any], _Look]) -> Sequence[_Look]:
    """Look at the cells of ours."""
    looks = []
    for load, cell in cells.iterrows():
        is_there = cell['producer_orders'] > 0
        look = judge(cell) if is_there else _Look('NOT MEASURED', 'ours not measured')
        looks.append(look._replace(words=f'{load}: {look.words}'))
    return looks


def _none(cells: pd.DataFrame, words: str, counted: str, called: str = '') -> Goal:
    """Judge a count that must be 0 in every cell."""

    def judge(cell: Any) -> _Look:
        number, sent = cell[f'{counted}_orders'], cell['producer_orders']
        verdict: Verdict = 'FAIL' if number else 'PASS'
        return _Look(verdict, f'{count(number)} of {count(sent)} {called or counted}')

    goal = _goal(words, _looks(cells, judge))
    if goal.verdict == 'PASS':
        sent = count(cells['producer_orders'].sum())
        return goal._replace(why=f'0 of {sent} orders in {of_cells(len(cells))}')
    return goal


def _median(cell: Any) -> _Look:
    median, bare = cell['latency_median_ms'], cell['bare_median_ms']
    if pd.isna(median):
        return _NOTHING_CAME
    beside = '' if pd.isna(bare) else f' (bare loops: {digits(bare, 4)} ms)'
    return _Look(_at_most(median, MEDIAN_MS), f'{digits(median, 4)} ms{beside}')


def _against_bare(cell: Any) -> _Look:
    p99, bare, ratio = cell['latency_p99_ms'], cell['bare_p99_ms'], cell['ratio']
    if pd.isna(p99):
        return _NOTHING_CAME
    if pd.isna(ratio):
        return _Look('NOT MEASURED', 'bare loops not measured')
    words = f'{digits(p99)} ms against {digits(bare)} ms'
    if cell['consumer_orders'] < _ENOUGH:
        words += f'; of only {count(cell["consumer_orders"])} orders'
    return _Look(_at_most(ratio, P99_RATIO), f'{digits(ratio, 4)} ({words})')


def _at_most(value: float, limit: float) -> Verdict:
    return 'PASS' if value <= limit else 'FAIL'


def of_cells(number: int) -> str:
    """Count cells: `1 cell`, `4 cells`."""
    return '1 cell' if number == 1 else f'{number} cells'
