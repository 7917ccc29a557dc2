"""The validator: checks every executed step by the rules alone (`rules`), and says what broke one.

What the modules only say it holds against the floor, too (`claims`).

It decides nothing and steers nothing. It reads what the modules say, hears what the robots did,
and compares. It may be started at any time: what was on its way before is taken as it is.
"""

from collections import deque
from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.claims import Claims
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Job, Limits, Rules, Seen
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.orders import OpenOrders
from ros2_kafka_warehouse.messages.robots import ActionStatus, ErrorLevel, FleetState, RobotState
from ros2_kafka_warehouse.messages.tasks import Task, Tasks, TaskStatus

KEPT: Final = 100  # violations in a report
_NOTHING: Final[frozenset[str]] = frozenset()
_FAULTS: Final = (ErrorLevel.CRITICAL, ErrorLevel.FATAL)
_UNDER_WAY: Final = (TaskStatus.PICKING, TaskStatus.CARRIED, TaskStatus.BLOCKED)


class Validator:
    """Hears what all modules hear, and judges each `FleetState`."""

    def __init__(self, site: Site, profiles: ExecutionProfiles | None = None) -> None:
        self.site = site
        self._profiles = profiles or ExecutionProfiles()
        self._referee = Referee(_rules(site, self._profiles))
        self._loads = self._referee.loads
        self._claims = Claims(site, self._loads, self._say)
        self._violations: deque[Violation] = deque(maxlen=KEPT)
        self._reported: tuple[Violation, ...] = ()
        self._seen: dict[str, tuple[RobotState, Seen]] = {}
        self._tasks: dict[str, Task] = {}
        self._newest_tasks: Tasks | None = None
        self._is_news = False
        self._newest_orders: OpenOrders | None = None
        self._heard_of: set[str] = set()
        self._removed: frozenset[str] = frozenset()
        self._floor = ''
        self._pallets: frozenset[Cell] = frozenset()

    @property
    def checked(self) -> int:
        """How many steps were checked."""
        return self._claims.checked

    def profile(self, profiles: ExecutionProfiles) -> None:
        """Take the newest profiles: what each type of robot may carry, and how fast it is."""
        if profiles is not self._profiles:
            self._profiles = profiles
            self._referee.change(_rules(self.site, profiles))

    def know(self, tasks: Tasks) -> None:
        """Take the newest tasks: where each load has to go, and which are said to be there."""
        if tasks is self._newest_tasks:
            return
        self._newest_tasks = tasks
        known = self._tasks
        for task in tasks.tasks:
            before = known.get(task.task_id)
            if task is not before:
                known[task.task_id] = task
                self._take_task(task, before, tasks.step)
        if len(known) > len(tasks.tasks):
            for gone in known.keys() - {task.task_id for task in tasks.tasks}:
                del known[gone]
                self._loads.forget(gone)
                self._claims.leave(gone)
        self._claims.told_all()

    def expect(self, orders: OpenOrders) -> None:
        """Take the newest open orders: which of their lines are said to be delivered."""
        if orders is self._newest_orders:
            return
        self._newest_orders = orders
        self._claims.expect(orders)

    def hear(self, report: FleetReport) -> None:
        """Take the newest report: which of the silent robots were carried off the floor."""
        reported = {robot.serial_number for robot in report.robots}
        away = {robot.serial_number for robot in report.robots if robot.is_off_the_floor}
        self._removed = frozenset(away | (self._heard_of - reported))
        self._heard_of |= reported

    def check(self, state: FleetState, now_s: float) -> ValidatorReport:
        """Judge one executed step."""
        floor = state.floor.get('floor', '')
        if floor != self._floor:
            self._floor = floor
            self._pallets = _pallets(floor)
        robots = tuple([self._seen_now(robot) for robot in state.states])
        found = self._referee.check(Frame(state.step, now_s, robots, self._removed, self._pallets))
        for violation in found:
            self._say(violation)
        self._claims.judge(state.step)
        if self._is_news:
            self._is_news = False
            self._reported = tuple(self._violations)
        return ValidatorReport(state.step, self.checked, self._reported)

    def finish(self) -> tuple[Violation, ...]:
        """At the end of a simulation: all violations, and deliveries that were only claimed."""
        self._claims.finish()
        return tuple(self._violations)

    def _seen_now(self, state: RobotState) -> Seen:
        known = self._seen.get(state.serial_number)
        if known is not None and known[0] is state:
            return known[1]
        lost_one = known is not None and known[1].loads and not state.loads
        seen = _seen(state, _dropped(state) if lost_one else _NOTHING)
        if state.loads and (known is None or known[0].loads != state.loads):
            self._claims.show(state.serial_number, state.loads)
        self._seen[state.serial_number] = (state, seen)
        return seen

    def _take_task(self, task: Task, before: Task | None, step: int) -> None:
        if before is None:
            if task.status is TaskStatus.DELIVERED:
                self._loads.take_as_delivered(task.task_id)
            elif task.carried or task.status in _UNDER_WAY or task.stranded:
                self._loads.excuse(task.task_id)
        self._claims.note(task, before, step)
        if before is None or _differ(task, before):
            self._loads.know(self._job(task))

    def _job(self, task: Task) -> Job:
        product = self.site.products.get(task.product)
        return Job(
            task_id=task.task_id,
            sources=frozenset(product.cells if product else (task.pickup,)),
            delivery=task.delivery,
            released_s=task.released_s,
            weight_kg=product.weight_kg * task.quantity if product else task.weight_kg,
            size=product.size if product else '',
            stranded=task.stranded or task.attempt > 0,
        )

    def _say(self, violation: Violation) -> None:
        self._violations.append(violation)
        self._is_news = True


def _rules(site: Site, profiles: ExecutionProfiles) -> Rules:
    return Rules(
        rows=site.rows,
        types={
            name: Limits(
                kind.steps_per_cell,
                kind.max_load_kg,
                frozenset(kind.sizes),
                acts_at_once=min(kind.pick_steps, kind.drop_steps) == 0,
            )
            for name, kind in profiles.robot_types.items()
        },
        homes={name: place.home for name, place in site.robots.items()},
    )


def _differ(task: Task, before: Task) -> bool:
    return (
        task.product != before.product
        or task.quantity != before.quantity
        or task.delivery != before.delivery
        or task.released_s != before.released_s
        or task.stranded != before.stranded
        or task.attempt != before.attempt
        or task.carried != before.carried
    )


def _seen(state: RobotState, dropped: frozenset[str]) -> Seen:
    return Seen(
        robot=state.serial_number,
        cells=state.cells,
        loads=tuple([load.load_id for load in state.loads]),
        type=state.robot_type,
        charge=state.power_supply.state_of_charge,
        faulty=bool(state.errors) and any(error.error_level in _FAULTS for error in state.errors),
        dropped=dropped,
    )


def _dropped(state: RobotState) -> frozenset[str]:
    return frozenset(
        action.action_id.rpartition('#')[0]
        for action in state.action_states
        if action.action_type == 'drop' and action.action_status is ActionStatus.FINISHED
    )


class _Floor(msgspec.Struct):
    """Of what the simulation keeps of its floor: where pallets stand, known to nobody else."""

    pallets: list[tuple[Cell, str]] = []


def _pallets(floor: str) -> frozenset[Cell]:
    if not floor:
        return frozenset()
    return frozenset(cell for cell, _ in msgspec.json.decode(floor, type=_Floor).pallets)
