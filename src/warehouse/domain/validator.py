"""The validator: checks every executed step by the rules alone (`rules`), and says what broke one.

It decides nothing and steers nothing. It reads what the modules say, hears what the robots did,
and compares. It may be started at any time: what was on its way before is taken as it is.
"""

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

import msgspec

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.rules import Frame, Job, Limits, Referee, Rules, Seen
from warehouse.domain.site import Site
from warehouse.messages import (
    ActionStatus,
    ErrorLevel,
    FleetReport,
    FleetState,
    LineStatus,
    OpenOrders,
    RobotState,
    Task,
    Tasks,
    TaskStatus,
    ValidatorReport,
    Violation,
)

__all__ = ['TraceError', 'Validator', 'validate_trace']

Cell = tuple[int, int]

KEPT: Final = 100  # violations in a report
_NOTHING: Final[frozenset[str]] = frozenset()
_FAULTS: Final = (ErrorLevel.CRITICAL, ErrorLevel.FATAL)
_UNDER_WAY: Final = (TaskStatus.PICKING, TaskStatus.CARRIED, TaskStatus.BLOCKED)


class Validator:
    """Hears what all modules hear, and judges each `FleetState`."""

    def __init__(self, site: Site, profiles: ExecutionProfiles | None = None) -> None:
        self.site = site
        self.checked = 0
        self._profiles = profiles or ExecutionProfiles()
        self._referee = Referee(_rules(site, self._profiles))
        self._violations: deque[Violation] = deque(maxlen=KEPT)
        self._reported: tuple[Violation, ...] = ()
        self._seen: dict[str, tuple[RobotState, Seen]] = {}
        self._tasks: dict[str, Task] = {}
        self._newest_tasks: Tasks | None = None
        self._claims: dict[str, int] = {}
        self._lines: set[str] | None = None
        self._newest_orders: OpenOrders | None = None
        self._heard_of: set[str] = set()
        self._removed: frozenset[str] = frozenset()
        self._floor = ''
        self._pallets: frozenset[Cell] = frozenset()
        self._step = -1

    def profile(self, profiles: ExecutionProfiles) -> None:
        """Take the newest profiles: what each type of robot may carry, and how fast it is."""
        if profiles is not self._profiles:
            self._profiles = profiles
            self._referee.rules = _rules(self.site, profiles)

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
                self._referee.forget(gone)

    def expect(self, orders: OpenOrders) -> None:
        """Take the newest open orders: which of their lines are said to be delivered."""
        if orders is self._newest_orders:
            return
        self._newest_orders = orders
        lines = {
            f'{order.order_id}/{line.line_id}'
            for order in orders.orders
            for line in order.lines
            if line.status is LineStatus.DELIVERED
        }
        if self._lines is None:
            for task_id in lines:
                self._referee.take_as_delivered(task_id)
        else:
            for task_id in lines - self._lines:
                # Orders do not say which step they reflect: the frame may be on its way.
                if self._referee.was_delivered(task_id) is False:
                    self._claims[task_id] = self._step + 10
        self._lines = lines

    def hear(self, report: FleetReport) -> None:
        """Take the newest report: which of the silent robots were carried off the floor."""
        reported = {robot.serial_number for robot in report.robots}
        away = {
            robot.serial_number
            for robot in report.robots
            if not robot.commissioned and not robot.obstacle
        }
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
        self._step = state.step
        self.checked += 1
        if found:
            self._violations.extend(found)
        if self._claims:
            self._check_claims([task for task, step in self._claims.items() if step <= state.step])
        if len(self._violations) != len(self._reported) or found:
            self._reported = tuple(self._violations)
        return ValidatorReport(state.step, self.checked, self._reported)

    def finish(self) -> tuple[Violation, ...]:
        """At the end of a simulation: all violations, and deliveries that were only claimed."""
        self._check_claims(self._claims)
        return tuple(self._violations)

    def _seen_now(self, state: RobotState) -> Seen:
        known = self._seen.get(state.serial_number)
        if known is not None and known[0] is state:
            return known[1]
        lost_one = known is not None and known[1].loads and not state.loads
        seen = _seen(state, _dropped(state) if lost_one else _NOTHING)
        self._seen[state.serial_number] = (state, seen)
        return seen

    def _take_task(self, task: Task, before: Task | None, step: int) -> None:
        if before is None:
            if task.status is TaskStatus.DELIVERED:
                self._referee.take_as_delivered(task.task_id)
            elif task.carried or task.status in _UNDER_WAY or task.stranded:
                self._referee.excuse(task.task_id)
        elif (
            task.status is TaskStatus.DELIVERED
            and before.status is not TaskStatus.DELIVERED
            # Once it was seen, it counts: a floor that starts again from an older state undoes it.
            and not self._referee.was_delivered(task.task_id)
        ):
            self._claims[task.task_id] = step
        if before is None or _differ(task, before):
            self._referee.know(self._job(task))

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

    def _check_claims(self, due: Iterable[str]) -> None:
        for task_id in tuple(due):
            step = self._claims.pop(task_id)
            if self._referee.was_delivered(task_id) is False:
                text = f'{task_id} is said to be delivered, and is not'
                self._violations.append(Violation(step, 'claimed', text))


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
    cells: tuple[Cell, ...] = (_cell(state.last_node_id),)
    if state.driving and state.node_states:
        cells = (*cells, _cell(state.node_states[0]))
    return Seen(
        robot=state.serial_number,
        cells=cells,
        loads=tuple([load.load_id for load in state.loads]),
        type=state.robot_type,
        charge=state.power_supply.state_of_charge,
        faulty=bool(state.errors) and any(error.error_level in _FAULTS for error in state.errors),
        dropped=dropped,
    )


_CELLS: dict[str, Cell] = {}  # a memory of what node ids mean, which is always the same


def _cell(node: str) -> Cell:
    cell = _CELLS.get(node)
    if cell is None:
        column, row = node.split(',')
        cell = _CELLS[node] = (int(column), int(row))
    return cell


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


# Traces in JSON lines.


class TraceError(ValueError):
    """A trace that cannot be read: says the line and what is wrong."""


class _TraceRobot(msgspec.Struct, frozen=True):
    id: str | int
    x: int
    y: int
    load: str | int | None = None
    to: Cell | None = None


class _TraceLine(msgspec.Struct, frozen=True):
    step: int
    robots: tuple[_TraceRobot, ...]
    removed: tuple[str, ...] = ()


def validate_trace(
    rows: Sequence[str],
    tasks: Sequence[tuple[int, Cell, Cell]] | None,
    lines: Iterable[str],
    *,
    crashed: Mapping[str, int] | None = None,
    unreachable: Collection[int] = (),
    walls: str = '@TOW',
) -> tuple[Violation, ...]:
    """Judge a trace of unit steps: `{"step", "robots": [{"id", "x", "y", "load"}]}` a line.

    A load is taken, and given, in the row of the step in which the robot stands on its cell.

    Args:
        rows: The map.
        tasks: Release step, pick-up and delivery of each task; `load` is the number of a task in
            this order. None: only moves are judged.
        lines: The trace, a JSON text a line.
        crashed: The step in which a robot crashed: from then it stands, and a robot next to it
            may take its load.
        unreachable: Tasks that need not be done.
        walls: What marks a wall on the map.

    Raises:
        TraceError: A line is not what it should be.
    """
    crashed = {str(robot): step for robot, step in (crashed or {}).items()}
    referee = Referee(Rules(tuple(rows), walls=walls))
    jobs = {
        str(number): Job(str(number), frozenset([pickup]), delivery, release)
        for number, (release, pickup, delivery) in enumerate(tasks or ())
    }
    for job in jobs.values():
        referee.know(job)
    found: list[Violation] = []
    stood: dict[str, Cell] = {}
    step = -1
    for line in _trace_lines(lines):
        if line.step <= step:
            raise TraceError(f'step {line.step} comes after step {step}')
        if line.step > step + 1 and step >= 0:
            found.append(Violation(line.step, 'missing', f'no step {step + 1} in the trace'))
        frame = _trace_frame(line, crashed, judge_loads=tasks is not None)
        if step < 0:
            empty = [seen._replace(loads=()) for seen in frame.robots]
            referee.check(frame._replace(step=line.step - 1, robots=tuple(empty)))
        step = line.step
        found += _judge_crashed(line, crashed, stood)
        for seen in frame.robots:
            if seen.faulty and seen.loads and seen.loads[0] in jobs:
                referee.know(jobs[seen.loads[0]]._replace(stranded=True))
        found += referee.check(frame)
    found += [
        Violation(step, 'undone', f'task {number} was not delivered')
        for number in range(len(tasks or ()))
        if number not in unreachable and not referee.was_delivered(str(number))
    ]
    return tuple(found)


def _trace_lines(lines: Iterable[str]) -> Iterable[_TraceLine]:
    decoder = msgspec.json.Decoder(_TraceLine, strict=False)
    for number, text in enumerate(lines, 1):
        if not text.strip():
            continue
        try:
            yield decoder.decode(text)
        except msgspec.DecodeError as error:
            raise TraceError(f'line {number}: {error}') from None


def _judge_crashed(
    line: _TraceLine, crashed: Mapping[str, int], stood: dict[str, Cell]
) -> list[Violation]:
    found = []
    for robot in line.robots:
        name = str(robot.id)
        if name in crashed and line.step >= crashed[name]:
            cell = stood.setdefault(name, (robot.x, robot.y))
            if cell != (robot.x, robot.y):
                text = f'{name} crashed at {cell}, and drives'
                found.append(Violation(line.step, 'crashed', text, (name,)))
    return found


def _trace_frame(line: _TraceLine, crashed: Mapping[str, int], *, judge_loads: bool) -> Frame:
    return Frame(
        line.step,
        float(line.step),
        tuple(
            [
                Seen(
                    robot=str(robot.id),
                    cells=((robot.x, robot.y), robot.to) if robot.to else ((robot.x, robot.y),),
                    loads=(str(robot.load),) if judge_loads and robot.load is not None else (),
                    faulty=str(robot.id) in crashed and line.step >= crashed[str(robot.id)],
                )
                for robot in line.robots
            ]
        ),
        frozenset(line.removed),
    )
