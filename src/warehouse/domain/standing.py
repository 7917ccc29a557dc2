"""How a robot stands, from all its failures: what the other modules are told to act on."""

from collections.abc import Iterable
from itertools import chain
from typing import Final, NamedTuple

from warehouse.domain.evidence import Watch
from warehouse.domain.failures import LEVELS, Failure
from warehouse.messages import Cell, ErrorLevel, RobotReport, node_cell

__all__ = ['OFF_THE_FLOOR', 'RISK_S', 'WELL', 'Standing', 'report_of', 'standing_of']

RISK_S: Final = 3600.0  # failures of the last hour make a robot a risk
RISK_EACH: Final = 0.1
RISK_SLOW: Final = 0.3

_STANDS: Final = frozenset(('freeze', 'safe_stop', 'obstacle', 'out_of_service'))
_TAKES_TASKS: Final = frozenset(('release', 'reassign'))


class Standing(NamedTuple):
    """What the report on a robot says beside its state; see `RobotReport`.

    Attributes:
        closes: Its cells are an obstacle.
        area: Cells around it that are one, too.
    """

    commissioned: bool = True
    can_move: bool = True
    keeps_task: bool = True
    charge: str = ''
    failure: str = ''
    level: ErrorLevel | None = None
    risk: float = 0.0
    answer: str = ''
    since_s: float = 0.0
    closes: bool = False
    area: tuple[Cell, ...] = ()


WELL: Final = Standing()
OFF_THE_FLOOR: Final = Standing(
    commissioned=False,
    can_move=False,
    keeps_task=False,
    failure='REMOVED',
    answer='taken off the floor',
)


def report_of(watch: Watch, standing: Standing) -> RobotReport:
    """The report on a robot."""
    return RobotReport(
        watch.state.serial_number,
        watch.state,
        watch.seen_s,
        standing.commissioned,
        standing.can_move,
        _closed(watch, standing),
        standing.keeps_task,
        standing.charge,
        standing.failure,
        standing.level,
        standing.risk,
        standing.answer,
        standing.since_s,
    )


def standing_of(
    failures: Iterable[Failure], history: Iterable[tuple[str, float]], now_s: float
) -> Standing:
    """What all failures of a robot make of it, the worst one first."""
    ranked = sorted(failures, key=lambda one: (-LEVELS[one.level], one.since_s))
    active = frozenset(chain.from_iterable(one.active for one in ranked))
    recent = sum(now_s - at_s < RISK_S for _, at_s in history)
    risk = min(0.9, RISK_EACH * recent + (RISK_SLOW if 'slow' in active else 0.0))
    if not ranked:
        return Standing(risk=risk)
    worst = ranked[0]
    return Standing(
        'out_of_service' not in active,
        not active & _STANDS,
        not active & _TAKES_TASKS,
        'now' if 'charge_now' in active else 'soon' if 'charge_soon' in active else '',
        worst.code,
        worst.level,
        risk,
        '; '.join(one.said for one in ranked if one.said),
        worst.since_s,
        bool(active & _STANDS),
        tuple(chain.from_iterable(one.area for one in ranked)),
    )


def _closed(watch: Watch, standing: Standing) -> tuple[Cell, ...]:
    """The cells that a robot closes: those that it holds or may drive to, and its area."""
    if standing is OFF_THE_FLOOR or not (standing.closes or watch.missing_s is not None):
        return ()
    cells = watch.state.cells
    if watch.missing_s is not None and watch.ahead:
        # It may have driven on to the last node that was released to it.
        cells = (*cells, node_cell(watch.ahead))
    return tuple(dict.fromkeys((*cells, *standing.area)))
