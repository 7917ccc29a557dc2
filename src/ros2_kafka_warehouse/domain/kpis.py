"""Key figures, kept up to date event by event and step by step."""

from collections import Counter, OrderedDict, deque
from collections.abc import Collection, Iterable
from math import ceil
from typing import Any, Final, NamedTuple

import msgspec

from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport
from ros2_kafka_warehouse.messages.onlookers import Plans
from ros2_kafka_warehouse.messages.orders import ORDER_ENDS, Order, OrderEvent, OrderStatus
from ros2_kafka_warehouse.messages.robots import ActionStatus, ErrorLevel, FleetState, RobotState
from ros2_kafka_warehouse.messages.tasks import Assignments

ACTIVITIES: Final = ('working', 'travelling', 'waiting', 'idle', 'charging', 'failed')
HOUR_S: Final = 3600.0
GRACE_S: Final = 60.0  # after which an order that was accepted must be open or ended
KEPT: Final = 5000  # values behind means and percentiles
REMEMBERED: Final = 100_000  # orders and lines, to find what ends twice

_SERIOUS: Final = (ErrorLevel.CRITICAL, ErrorLevel.FATAL)
_RUNNING: Final = (ActionStatus.INITIALIZING, ActionStatus.RUNNING)


class KpiView(Message, frozen=True):
    """The figures at one time; None where there is nothing to count yet.

    Attributes:
        orders_per_hour: Orders that were delivered, of the last hour.
        tasks_per_hour: Lines that were delivered, of the last hour.
        on_time: Share that was delivered, whole and not late, of the orders with a due time that
            have ended (cancelled ones aside) or are open and past it.
        mean_late_s: How late these were, or are by now, on average; what was early counts as 0.
        cycle_mean_s: From receiving an order to its delivery; `cycle_p50_s`, `cycle_p95_s`, too.
        hand_over_s: Median of the times from the detection of a failure to the robot that has
            the task instead; there were `hand_overs`.
        deadlocks: Robots that had a task, a free way and made no progress.
        stuck: Robots that need a right of way now.
        shares: Of the time of all robots, what they did, by the names in `ACTIVITIES`.
        availability: Share of the time in which robots were not failed.
        mtbf_s: Robot time between failures that stopped a robot, in the steps that `shares`
            looks back; `mttr_s` until those ended.
        lost: Orders that were accepted, and are neither open nor ended.
        duplicated: Orders or lines that ended twice.
    """

    orders_per_hour: float | None = None
    tasks_per_hour: float | None = None
    received: int = 0
    delivered: int = 0
    partial: int = 0
    failed: int = 0
    cancelled: int = 0
    lines_delivered: int = 0
    on_time: float | None = None
    mean_late_s: float | None = None
    cycle_mean_s: float | None = None
    cycle_p50_s: float | None = None
    cycle_p95_s: float | None = None
    hand_over_s: float | None = None
    hand_overs: int = 0
    failures: int = 0
    deadlocks: int = 0
    stuck: int = 0
    shares: dict[str, float] = msgspec.field(default_factory=dict)
    availability: float | None = None
    mtbf_s: float | None = None
    mttr_s: float | None = None
    lost: int = 0
    duplicated: int = 0
    planner_p50_ms: float | None = None
    planner_max_ms: float | None = None


class Kpis:
    """Takes what happens, and says the figures.

    Args:
        step_s: Seconds that a step of the fleet takes.
        window_steps: Steps that `shares` and `availability` look back; 0: to the beginning.
    """

    def __init__(self, step_s: float = 0.5, window_steps: int = 0) -> None:
        self._step_s = step_s
        self._orders = _Orders()
        self._failures = _Failures()
        self._activities = _Activities(window_steps)
        self._planner_ms: deque[float] = deque(maxlen=KEPT)
        self._stuck = 0

    def take_event(self, event: OrderEvent) -> None:
        """An order or a line has reached a status; a repeat changes nothing."""
        self._orders.take(event)

    def take_failure(self, event: FailureEvent) -> None:
        """A failure was seen, judged, answered, or is over."""
        self._failures.take(event)

    def take_state(self, state: FleetState) -> None:
        """What the robots did in a step; a repeated step counts once."""
        self._activities.take_state(state)

    def take_report(self, report: FleetReport) -> None:
        """Which robots have failed."""
        self._activities.take_report(report)

    def take_assignments(self, assignments: Assignments) -> None:
        """Which robots have something to do."""
        self._activities.take_assignments(assignments)

    def take_plans(self, plans: Plans) -> None:
        """A plan was made."""
        self._planner_ms.append(plans.planner_ms)
        self._stuck = plans.stuck

    def view(self, now_s: float, open_orders: Collection[Order] = ()) -> KpiView:
        """The figures now; `open_orders` are those that have not ended."""
        orders, failures = self._orders, self._failures
        totals = self._activities.totals
        steps = sum(totals.values())
        began_s = now_s - self._activities.steps * self._step_s
        serious = sum(time_s >= began_s for time_s in failures.serious.values())
        overdue = [
            _Lateness(now_s - order.due_s)
            for order in open_orders
            if order.due_s is not None and order.due_s < now_s and not order.cancelled
        ]
        due = [*orders.due, *overdue]
        in_service_s = (steps - totals['failed']) * self._step_s
        return KpiView(
            orders_per_hour=orders.per_hour(orders.delivered_s, now_s),
            tasks_per_hour=orders.per_hour(orders.lines_s, now_s),
            received=orders.count['received'],
            delivered=orders.count[OrderStatus.DELIVERED],
            partial=orders.count[OrderStatus.PARTIAL],
            failed=orders.count[OrderStatus.FAILED],
            cancelled=orders.count[OrderStatus.CANCELLED],
            lines_delivered=orders.count['lines'],
            on_time=_mean([one.delivered and one.late_s <= 0 for one in due]),
            mean_late_s=_mean([max(0.0, one.late_s) for one in due]),
            cycle_mean_s=_mean(orders.cycles_s),
            cycle_p50_s=percentile(orders.cycles_s, 0.5),
            cycle_p95_s=percentile(orders.cycles_s, 0.95),
            hand_over_s=percentile(failures.hand_overs_s, 0.5),
            hand_overs=len(failures.hand_overs_s),
            failures=failures.count,
            deadlocks=failures.deadlocks,
            stuck=self._stuck,
            shares={name: totals[name] / steps for name in ACTIVITIES} if steps else {},
            availability=1 - totals['failed'] / steps if steps else None,
            mtbf_s=in_service_s / serious if serious else None,
            mttr_s=_mean(failures.repairs_s),
            lost=len(orders.lost(now_s, {order.order_id for order in open_orders})),
            duplicated=len(orders.duplicated),
            planner_p50_ms=percentile(self._planner_ms, 0.5),
            planner_max_ms=max(self._planner_ms, default=None),
        )


class _Lateness(NamedTuple):
    """Of an order with a due time."""

    late_s: float
    delivered: bool = False


class _Orders:
    """What became of the orders."""

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()
        self.duplicated: set[tuple[str, str]] = set()
        self.due: deque[_Lateness] = deque(maxlen=KEPT)
        self.cycles_s: deque[float] = deque(maxlen=KEPT)
        self.delivered_s: deque[float] = deque(maxlen=REMEMBERED)
        self.lines_s: deque[float] = deque(maxlen=REMEMBERED)
        self._began_s: float | None = None
        self._waiting: dict[str, float] = {}
        self._ends: OrderedDict[tuple[str, str], tuple[int, OrderStatus]] = OrderedDict()

    def take(self, event: OrderEvent) -> None:
        if event.status is OrderStatus.RECEIVED and not event.line_id:
            self._receive(event)
        elif event.status in ORDER_ENDS:
            end = (event.order_update_id, event.status)
            key = (event.order_id, event.line_id)
            known = self._ends.get(key)
            if known is None:
                self._ends[key] = end
                self._end(event)
                if len(self._ends) > REMEMBERED:
                    self._ends.popitem(last=False)
            elif known != end:
                self.duplicated.add(key)

    def _receive(self, event: OrderEvent) -> None:
        if self._began_s is None:
            self._began_s = event.time_s
        known = event.order_id in self._waiting or (event.order_id, '') in self._ends
        if not known:
            self.count['received'] += 1
            self._waiting[event.order_id] = event.time_s

    def _end(self, event: OrderEvent) -> None:
        delivered = event.status is OrderStatus.DELIVERED
        if event.line_id:
            if delivered:
                self.count['lines'] += 1
                self.lines_s.append(event.time_s)
            return
        self.count[event.status] += 1
        began_s = self._waiting.pop(event.order_id, None)
        if event.late_s is not None and event.status is not OrderStatus.CANCELLED:
            self.due.append(_Lateness(event.late_s, delivered))
        if delivered:
            self.delivered_s.append(event.time_s)
            if began_s is not None:
                self.cycles_s.append(event.time_s - began_s)

    def per_hour(self, times_s: deque[float], now_s: float) -> float | None:
        """How often something was in the last hour, or since the first order."""
        if self._began_s is None:
            return None
        while times_s and times_s[0] < now_s - HOUR_S:
            times_s.popleft()
        since_s = max(self._began_s, now_s - HOUR_S)
        return HOUR_S * len(times_s) / max(now_s - since_s, GRACE_S)

    def lost(self, now_s: float, open_orders: Collection[str]) -> list[str]:
        return [
            order
            for order, since_s in self._waiting.items()
            if now_s - since_s > GRACE_S and order not in open_orders
        ]


class _Failures:
    """What became of the failures."""

    def __init__(self) -> None:
        self.count = 0
        self.deadlocks = 0
        self.serious: OrderedDict[str, float] = OrderedDict()  # when they were seen
        self.hand_overs_s: deque[float] = deque(maxlen=KEPT)
        self.repairs_s: deque[float] = deque(maxlen=KEPT)
        self._open: OrderedDict[str, float] = OrderedDict()
        self._handed_over: OrderedDict[tuple[str, str], None] = OrderedDict()

    def take(self, event: FailureEvent) -> None:
        if event.event == 'FailureDetected' and event.failure_id not in self._open:
            self._open[event.failure_id] = event.time_s
            self.count += 1
            if len(self._open) > REMEMBERED:
                self._open.popitem(last=False)
        if event.level in _SERIOUS and event.robot:
            self._note_serious(event)
        began_s = self._open.get(event.failure_id)
        if began_s is None:
            return
        if event.event == 'TaskReassigned':
            key = (event.failure_id, event.task_id)
            if key not in self._handed_over:
                self._handed_over[key] = None
                if len(self._handed_over) > REMEMBERED:
                    self._handed_over.popitem(last=False)
                self.hand_overs_s.append(event.time_s - began_s)
        elif event.event == 'FailureDiagnosed' and event.code == 'NO_PROGRESS':
            self.deadlocks += 1
        elif event.event == 'FailureResolved' and event.failure_id in self.serious:
            self.repairs_s.append(event.time_s - began_s)

    def _note_serious(self, event: FailureEvent) -> None:
        began_s = self._open.get(event.failure_id, event.time_s)
        self.serious.setdefault(event.failure_id, began_s)
        if len(self.serious) > REMEMBERED:
            self.serious.popitem(last=False)


class _Activities:
    """What the robots do, step by step."""

    def __init__(self, window_steps: int) -> None:
        self.totals: Counter[str] = Counter(dict.fromkeys(ACTIVITIES, 0))
        self.steps = 0  # that the totals are of
        self._window_steps = window_steps
        self._window: deque[Counter[str]] = deque()
        self._step = -1
        self._states: dict[str, RobotState] = {}
        self._failed: frozenset[str] = frozenset()
        self._known: frozenset[str] = frozenset()
        self._busy: frozenset[str] = frozenset()
        self._report: FleetReport | None = None
        self._assignments: Assignments | None = None

    def take_report(self, report: FleetReport) -> None:
        if report is self._report:
            return
        self._report = report
        self._known = frozenset([robot.serial_number for robot in report.robots])
        self._failed = frozenset(
            [
                robot.serial_number
                for robot in report.robots
                if not robot.commissioned or (robot.failure and robot.level in _SERIOUS)
            ]
        )

    def take_assignments(self, assignments: Assignments) -> None:
        if assignments is self._assignments:
            return
        self._assignments = assignments
        self._busy = frozenset([one.serial_number for one in assignments.assignments])

    def take_state(self, fleet: FleetState) -> None:
        if fleet.step == self._step:
            return
        self._step = fleet.step
        counts: dict[str, int] = {}
        before = self._states
        now: dict[str, RobotState] = {}
        for state in fleet.states:
            name = state.serial_number
            now[name] = state
            what = 'failed' if name in self._failed else self._what(state, before.get(name))
            counts[what] = counts.get(what, 0) + 1
        silent = sum(name not in now for name in self._known)
        counts['failed'] = counts.get('failed', 0) + silent
        self._states = now
        totals = self.totals
        for what, number in counts.items():
            totals[what] += number
        self.steps += 1
        if self._window_steps:
            self._window.append(Counter(counts))
            if len(self._window) > self._window_steps:
                totals.subtract(self._window.popleft())
                self.steps -= 1

    def _what(self, state: RobotState, before: RobotState | None) -> str:
        if state.power_supply.charging:
            return 'charging'
        drives = state.driving or (
            state is not before
            and before is not None
            and before.last_node_id != state.last_node_id
        )
        if drives:
            return 'working' if state.loads else 'travelling'
        if any(action.action_status in _RUNNING for action in state.action_states):
            return 'working'
        return 'waiting' if state.loads or state.serial_number in self._busy else 'idle'


def percentile(values: Iterable[float], share: float) -> float | None:
    """The least value that is not below that share of the values; None for no values."""
    ordered = sorted(values)
    return ordered[max(ceil(share * len(ordered)) - 1, 0)] if ordered else None


def _mean(values: Collection[Any]) -> float | None:
    return sum(values) / len(values) if values else None
