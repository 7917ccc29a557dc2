"""The validator: checks every executed step by the rules alone (`rules`), and says what broke one.

It decides nothing and steers nothing. It reads what the modules say, hears what the robots did,
and compares. It may be started at any time: what was on its way before is taken as it is.
"""

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import msgspec
from msgspec.structs import replace

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.rules import Frame, Job, Limits, Referee, Rules, Seen
from warehouse.domain.site import Site
from warehouse.messages import (
    ActionStatus,
    ErrorLevel,
    FleetReport,
    FleetState,
    LineStatus,
    Load,
    OpenOrders,
    Order,
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
# In steps that were checked; nothing is judged before all who take part may have heard of it.
GRACE: Final = 10  # for a delivery to be seen that is said to have happened
QUIET: Final = 20  # after the last news of a task, before it is compared with its order
FORMER: Final = 60  # in which an order counts as it was before an update, too
_NOTHING: Final[frozenset[str]] = frozenset()
_FAULTS: Final = (ErrorLevel.CRITICAL, ErrorLevel.FATAL)
_UNDER_WAY: Final = (TaskStatus.PICKING, TaskStatus.CARRIED, TaskStatus.BLOCKED)
_WAITING: Final = (TaskStatus.OPEN, TaskStatus.ASSIGNED, TaskStatus.BLOCKED)
_GIVEN_UP: Final = (TaskStatus.FAILED, TaskStatus.CANCELLED)
_GRAM: Final = 0.001
_ENDS: Final = (TaskStatus.DELIVERED, *_GIVEN_UP)
_LINES_GIVEN_UP: Final = (LineStatus.FAILED, LineStatus.CANCELLED)


class _Form(NamedTuple):
    """An order as an update has asked for it, and how many steps were checked by then."""

    heard: int
    order: Order


class _Ordered:
    """An order in all its forms, and since when it is no longer open."""

    __slots__ = ('forms', 'gone', 'order')

    def __init__(self, order: Order, heard: int) -> None:
        self.forms = [_Form(heard, order)]
        self.order = order
        self.gone: int | None = None

    def take(self, order: Order, heard: int) -> None:
        """Take it as it stands now."""
        # Between updates its lines become what was picked: nobody has asked for that.
        if order.order_update_id != self.order.order_update_id:
            self.forms.append(_Form(heard, order))
        self.order = order
        self.gone = None

    def since(self, heard: int) -> list[Order]:
        """The forms that were the newest at a time, or later."""
        older = sum(form.heard <= heard for form in self.forms)
        return [form.order for form in self.forms[max(older - 1, 0) :]]

    @property
    def released_s(self) -> float:
        """The earliest time at which it is said to have come."""
        return min(form.order.released_s for form in self.forms)


class _Told:
    """What was said of a task.

    Attributes:
        task: As it was said last.
        waited: When it was last said to wait in stock, untouched by any robot; None: it was on
            its way, or over, when it was first heard of.
        is_touched: A robot has had the load, or may have had it.
        given_up: It was said to have failed, or to be cancelled.
        line: How its line is said to have ended.
        accused: The rules that it is known to break.
    """

    __slots__ = ('accused', 'given_up', 'is_touched', 'line', 'task', 'waited')

    def __init__(self, task: Task, heard: int) -> None:
        self.task = task
        self.is_touched = _is_touched(task)
        self.waited = heard if _waits(task) else None
        self.given_up = task.status in _GIVEN_UP
        self.line = LineStatus.OPEN
        self.accused: set[str] = set()

    def take(self, task: Task, heard: int, heard_before: int) -> None:
        """Take it as it is said now; what was said before was still so at `heard_before`."""
        if self.waited is not None and not self.is_touched:
            if _waits(self.task):
                self.waited = heard_before
            if _waits(task):
                self.waited = heard
        self.is_touched = self.is_touched or _is_touched(task)
        self.given_up = self.given_up or task.status in _GIVEN_UP
        self.task = task


def _is_touched(task: Task) -> bool:
    return task.carried or task.stranded or task.attempt > 0


def _waits(task: Task) -> bool:
    """Whether any robot may take the load from stock: nobody has it, no change is on its way."""
    return task.status in _WAITING and not _is_touched(task) and not task.excluded


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
        self._ordered: dict[str, _Ordered] = {}
        self._told: dict[str, _Told] = {}
        self._told_at = 0
        self._shown: dict[str, tuple[str, Load]] = {}  # by load: who has it, and what it is
        self._doubts: dict[str, int] = {}  # by task: when it had news; the oldest come first
        self._is_news = False
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
                if gone not in self._doubts:
                    self._forget(gone)
        self._told_at = self.checked

    def expect(self, orders: OpenOrders) -> None:
        """Take the newest open orders: which of their lines are said to be delivered."""
        if orders is self._newest_orders:
            return
        self._newest_orders = orders
        self._take_orders(orders)
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
                    self._claims[task_id] = self.checked + GRACE
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
        for violation in found:
            self._say(violation)
        if self._claims:
            self._check_claims([task for task, due in self._claims.items() if due <= self.checked])
        if self._doubts:
            self._judge_doubts(self._told_at - QUIET)
        if self._is_news:
            self._is_news = False
            self._reported = tuple(self._violations)
        return ValidatorReport(state.step, self.checked, self._reported)

    def finish(self) -> tuple[Violation, ...]:
        """At the end of a simulation: all violations, and deliveries that were only claimed."""
        self._check_claims(self._claims)
        self._judge_doubts(self.checked)
        return tuple(self._violations)

    def _seen_now(self, state: RobotState) -> Seen:
        known = self._seen.get(state.serial_number)
        if known is not None and known[0] is state:
            return known[1]
        lost_one = known is not None and known[1].loads and not state.loads
        seen = _seen(state, _dropped(state) if lost_one else _NOTHING)
        if state.loads and (known is None or known[0].loads != state.loads):
            for load in state.loads:
                self._shown[load.load_id] = (state.serial_number, load)
                self._doubt(load.load_id)
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
            self._claims[task.task_id] = self.checked + GRACE
        elif task.status is not TaskStatus.DELIVERED:
            self._claims.pop(task.task_id, None)
        self._note(task, step)
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

    def _say(self, violation: Violation) -> None:
        self._violations.append(violation)
        self._is_news = True

    # What is said, against what is true.

    def _check_claims(self, due: Iterable[str]) -> None:
        for task_id in tuple(due):
            del self._claims[task_id]
            if self._referee.was_delivered(task_id) is False:
                text = f'{task_id} is said to be delivered, and is not'
                self._say(Violation(self._step, 'claimed', text))

    def _take_orders(self, orders: OpenOrders) -> None:
        """Note how each order is wanted, and which of its lines are said to be given up."""
        known = self._ordered
        for order in orders.orders:
            ordered = known.get(order.order_id)
            if ordered is None:
                known[order.order_id] = _Ordered(order, self.checked)
            elif ordered.order is not order or ordered.gone is not None:
                self._note_lines(order, ordered.order)
                ordered.take(order, self.checked)
        if len(known) > len(orders.orders):
            for order_id in known.keys() - {order.order_id for order in orders.orders}:
                self._leave(order_id, known[order_id])

    def _leave(self, order_id: str, ordered: _Ordered) -> None:
        if ordered.gone is None:
            ordered.gone = self.checked
        elif self.checked - ordered.gone > FORMER + QUIET:
            del self._ordered[order_id]

    def _note_lines(self, order: Order, before: Order) -> None:
        if order.lines == before.lines:
            return
        open_before = {line.line_id for line in before.lines if line.status is LineStatus.OPEN}
        for line in order.lines:
            told = self._told.get(f'{order.order_id}/{line.line_id}')
            if told is not None and line.line_id in open_before:
                told.line = line.status
                self._doubt(told.task.task_id)

    def _note(self, task: Task, step: int) -> None:
        """Note what is said of a task that is new or has changed."""
        told = self._told.get(task.task_id)
        if told is None:
            self._told[task.task_id] = _Told(task, self.checked)
        else:
            ends_now = told.task.status not in _ENDS and task.status in _GIVEN_UP
            told.take(task, self.checked, self._told_at)
            dropped = self._referee.dropped_step(task.task_id)
            # Whoever follows a robot up to that step has heard it say so.
            if ends_now and dropped is not None and dropped <= step:
                self._accuse(told, 'claimed', f'is said to be {task.status}, and was delivered')
        self._doubt(task.task_id)

    def _doubt(self, task_id: str) -> None:
        self._doubts.pop(task_id, None)  # to the end
        self._doubts[task_id] = self.checked

    def _judge_doubts(self, until: int) -> None:
        """Judge the tasks of which nothing new was said since then: all have heard the same."""
        while self._doubts:
            task_id = next(iter(self._doubts))
            if self._doubts[task_id] > until:
                return
            noted = self._doubts.pop(task_id)
            told = self._told.get(task_id)
            if told is not None:
                self._judge_wanted(told, noted)
                self._judge_shown(told)
                self._judge_line(told)
            if task_id not in self._tasks:
                self._forget(task_id)

    def _forget(self, task_id: str) -> None:
        self._told.pop(task_id, None)
        self._shown.pop(task_id, None)

    def _judge_wanted(self, told: _Told, noted: int) -> None:
        """Whether the task is what was ordered when its load was last in stock, or since."""
        task = told.task
        ordered = self._ordered.get(task.order_id)
        if ordered is None or told.waited is None:
            return
        if ordered.gone is not None and noted > ordered.gone:
            return  # of a load that is left of an ended order, others may know no more than that
        if task.released_s < ordered.released_s:
            late_s = ordered.released_s - task.released_s
            self._accuse(told, 'release', f'is released {late_s:g} s before its order')
        forms = ordered.since(told.waited - FORMER)
        stations = {form.station for form in forms}
        if task.delivery not in {self.site.stations.get(station) for station in stations}:
            wanted = ' or '.join(sorted(stations))
            self._accuse(told, 'station', f'goes to {task.delivery}, and was ordered to {wanted}')
        lines = {
            (line.product, line.quantity)
            for form in forms
            for line in form.lines
            if line.line_id == task.line_id
        }
        if not any(self._is_same(task, *line) for line in lines):
            wanted = ' or '.join(f'{quantity} {product}' for product, quantity in sorted(lines))
            text = f'is {task.quantity} {task.product}, ordered was {wanted or "no such line"}'
            self._accuse(told, 'product', text)

    def _is_same(self, task: Task, product: str, quantity: int) -> bool:
        if task.product != product:
            return False
        place = self.site.products.get(product)
        # Of a load that was picked the weight is known, to the gram, and the quantity by it.
        apart_kg = abs(task.quantity - quantity) * (place.weight_kg if place else 1.0)
        return apart_kg <= _GRAM

    def _judge_shown(self, told: _Told) -> None:
        """Whether its robot shows the load that the task says it carries."""
        task = told.task
        robot, load = self._shown.get(task.task_id, ('', None))
        if load is None or not task.carried or task.robot != robot:
            return
        products = self.site.products
        if load.load_type in products and load.load_type != task.product:
            text = f'is {task.product}, and {robot} shows {load.load_type}'
            self._accuse(told, 'load', text, robot)
        elif load.weight > 0 and task.product in products:
            each_kg = products[task.product].weight_kg
            # A robot may weigh its load: half a piece more or less is the same quantity.
            if abs(load.weight - task.quantity * each_kg) > each_kg / 2 + _GRAM:
                text = f'is {task.quantity} {task.product}, and {robot} shows {load.weight:g} kg'
                self._accuse(told, 'load', text, robot)

    def _judge_line(self, told: _Told) -> None:
        is_delivered = told.task.status is TaskStatus.DELIVERED
        if told.line in _LINES_GIVEN_UP and is_delivered and not told.given_up:
            self._accuse(told, 'claimed', f'is said to be {told.line} as a line, and is delivered')

    def _accuse(self, told: _Told, rule: str, text: str, *robots: str) -> None:
        if rule not in told.accused:
            told.accused.add(rule)
            description = f'{told.task.task_id} {text}'
            self._say(Violation(self._step, rule, description, robots))


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


class _TraceFailure(msgspec.Struct, frozen=True):
    robot: str = ''


class _TraceLine(msgspec.Struct, frozen=True):
    step: int
    robots: tuple[_TraceRobot, ...]
    removed: tuple[str, ...] = ()
    failures: tuple[_TraceFailure, ...] | None = None
    events: tuple[msgspec.Raw, ...] | None = None


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
    sight = _Sight()
    for line in _trace_lines(lines):
        if sight.last is not None and line.step <= step:
            raise TraceError(f'step {line.step} comes after step {step}')
        if sight.last is not None and line.step > step + 1:
            found.append(Violation(line.step, 'missing', f'no step {step + 1} in the trace'))
        frame = _trace_frame(line, crashed, judge_loads=tasks is not None)
        if sight.last is None:
            found += _judge_start(referee, frame)
        step = line.step
        sight.note(line)
        found += _judge_crashed(line, crashed, stood)
        for seen in frame.robots:
            if seen.faulty and seen.loads and seen.loads[0] in jobs:
                referee.know(jobs[seen.loads[0]]._replace(stranded=True))
        found += referee.check(frame)
    if sight.last is None:
        raise TraceError('there is no step in it')
    found += sight.vanished()
    found += [
        Violation(step, 'undone', f'task {number} was not delivered')
        for number in range(len(tasks or ()))
        if number not in unreachable and not referee.was_delivered(str(number))
    ]
    return tuple(found)


class _Sight:
    """Which robots a trace shows: each to the end, or it says why not."""

    def __init__(self) -> None:
        self.last: _TraceLine | None = None
        self._seen: dict[str, int] = {}  # by robot: the last step that shows it
        self._failed: set[str] = set()
        self._has_log = False

    def note(self, line: _TraceLine) -> None:
        """Take the next line."""
        self.last = line
        self._seen.update((str(robot.id), line.step) for robot in line.robots)
        self._failed.update(failure.robot for failure in line.failures or ())
        self._has_log = self._has_log or (line.failures or line.events) is not None

    def vanished(self) -> list[Violation]:
        """The robots that are not there at the end, and neither failed nor were taken away."""
        assert self.last is not None
        end, excused = self.last.step, {*self.last.removed, *self._failed}
        # A floor that tells of failures does so only when a robot was silent for some time.
        patience = QUIET if self._has_log else 0
        return [
            Violation(step, 'vanished', f'{robot} is not seen after step {step}', (robot,))
            for robot, step in self._seen.items()
            if step + patience < end and robot not in excused
        ]


def _judge_start(referee: Referee, frame: Frame) -> tuple[Violation, ...]:
    """Where the robots are at first; their loads they take in that step."""
    empty = tuple([seen._replace(loads=()) for seen in frame.robots])
    found = referee.check(frame._replace(step=frame.step - 1, robots=empty))
    # Those that are in the same cell still are so in the step itself.
    return tuple(replace(one, step=frame.step) for one in found if one.rule != 'collision')


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
