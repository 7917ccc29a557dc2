"""How a robot stands, from all its failures: what the other modules are told to act on."""

from collections import defaultdict
from collections.abc import Iterable
from itertools import chain
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.evidence import Watch
from ros2_kafka_warehouse.domain.failures import LEVELS, Failure
from ros2_kafka_warehouse.domain.monitor_memory import Memory
from ros2_kafka_warehouse.messages.message import Cell, node_cell
from ros2_kafka_warehouse.messages.monitor import RobotReport
from ros2_kafka_warehouse.messages.robots import ErrorLevel

RISK_S: Final = 3600.0  # failures of the last hour make a robot a risk
RISK_EACH: Final = 0.1
RISK_SLOW: Final = 0.3

_STANDS: Final = frozenset(('freeze', 'safe_stop', 'obstacle', 'out_of_service'))
TAKES_TASKS: Final = frozenset(('release', 'reassign'))


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
_OFF_THE_FLOOR: Final = Standing(
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


def standings_of(robots: Iterable[str], memory: Memory, now_s: float) -> dict[str, Standing]:
    """How each of these robots stands that is not simply well."""
    by_robot = defaultdict[str, list[Failure]](list)
    for failure in memory.failures:
        by_robot[failure.robot].append(failure)
    standings = {}
    for name in robots:
        history = memory.history.get(name, ())
        if name in memory.removed:
            standings[name] = _OFF_THE_FLOOR
        elif name in by_robot or history:
            standings[name] = _standing_of(by_robot[name], history, now_s)
    return standings


def _standing_of(
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
        not active & TAKES_TASKS,
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
    if standing is _OFF_THE_FLOOR or not (standing.closes or watch.missing_s is not None):
        return ()
    cells = watch.state.cells
    if watch.missing_s is not None and watch.ahead:
        # It may have driven on to the last node that was released to it.
        cells = (*cells, node_cell(watch.ahead))
    return tuple(dict.fromkeys((*cells, *standing.area)))
