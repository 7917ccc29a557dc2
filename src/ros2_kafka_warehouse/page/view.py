"""The newest of everything that Kafka says of the warehouse, in sections for browsers."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec

from ros2_kafka_warehouse.codec import MessageError, decode
from ros2_kafka_warehouse.domain.kpis import Kpis, KpiView
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell, Message
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport, OperatorCommand
from ros2_kafka_warehouse.messages.onlookers import Plans, ValidatorReport, Violation
from ros2_kafka_warehouse.messages.orders import (
    OpenOrders,
    Order,
    OrderEvent,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments, Task, Tasks
from ros2_kafka_warehouse.page.bounds import SHOWN_LINES, keep, short_event, short_request, within
from ros2_kafka_warehouse.page.intake import Intake
from ros2_kafka_warehouse.page.rows import (
    OrderRow,
    RobotRow,
    ended_row,
    failure_row,
    order_row,
    robot_row,
)
from ros2_kafka_warehouse.page.sections import Sections

_KEPT_ENDS = 100
_KEPT_FAILURES = 200
_KEPT_EVENTS_OF_ONE = 60
_KEPT_REQUESTS = 2000
_KEPT_PLACED = 200
_WINDOW_STEPS = 1200  # that the use of the robots looks back
_SHOWN_OPEN = 300
_SHOWN_VIOLATIONS = 20
_SHOWN_ENDED_BYTES = 256 * 1024  # each browser gets them again with each change


class _Take(NamedTuple):
    kind: type[Message]
    take: Callable[[Any], None]


class _Ended(NamedTuple):
    """An order that has ended; encoded at once, so that what cannot be is not kept."""

    row: OrderRow
    encoded: msgspec.Raw


class View:
    """What the page shows. Not for more than one thread.

    Args:
        site: Its metres are turned into cells.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._fleet = FleetState(step=-1)
        self._moved: frozenset[str] = frozenset()
        self._report = FleetReport(step=-1)
        self._open = OpenOrders()
        self._tasks: dict[str, Task] = {}
        self._assignments: dict[str, Assignment] = {}
        self._plans = Plans(step=-1)
        self._validator: ValidatorReport | None = None
        self._acknowledged: frozenset[_ViolationName] = frozenset()
        self._begun_s: float | None = None
        self._intake = Intake()
        self._orders: OrderedDict[str, Order] = OrderedDict()  # as last seen open
        self._ended: OrderedDict[str, _Ended] = OrderedDict()
        self._lines: OrderedDict[str, dict[str, OrderEvent]] = OrderedDict()
        self._received: OrderedDict[str, float] = OrderedDict()
        self._requests: OrderedDict[str, OrderRequest] = OrderedDict()
        self._failures: OrderedDict[str, dict[tuple[str, float, str], FailureEvent]] = (
            OrderedDict()
        )
        self._placed: OrderedDict[Cell, None] = OrderedDict()
        self._kpis = Kpis(site.step_s, _WINDOW_STEPS)
        self._now_s = 0.0
        self._heard_s: dict[str, float] = {}
        self._unreadable = 0
        self._kafka_away = ''
        self._rate = 0.0
        self._takes = {
            'warehouse.open-orders': _Take(OpenOrders, self._take_open),
            'warehouse.tasks': _Take(Tasks, self._take_tasks),
            'warehouse.assignments': _Take(Assignments, self._take_assignments),
            'warehouse.robots': _Take(FleetState, self._take_fleet),
            'warehouse.fleet': _Take(FleetReport, self._take_report),
            'warehouse.plans': _Take(Plans, self._take_plans),
            'warehouse.validator': _Take(ValidatorReport, self._take_validator),
            'warehouse.orders': _Take(OrderRequest, self._take_request),
            'warehouse.commands': _Take(OperatorCommand, self._take_command),
            'warehouse.order-events': _Take(OrderEvent, self._take_event),
            'warehouse.failures': _Take(FailureEvent, self._take_failure),
        }
        self._sections = Sections(
            {
                'floor': self._floor_section,
                'plans': self._plans_section,
                'orders': self._orders_section,
                'failures': self._failures_section,
                'kpis': self._kpis_section,
                'validator': self._validator_section,
                'health': self._health_section,
            }
        )

    def take(self, topic: str, value: bytes | None, now_s: float, made_s: float) -> None:
        """Take a record; what cannot be read is counted.

        `made_s` is the record's own time: an old snapshot is old, though it comes now.
        """
        kind, take = self._takes[topic]
        try:
            message = decode(value or b'', kind)
        except MessageError:
            self._unreadable += 1
            return
        if self._begun_s is None:
            self._begun_s = now_s
        self._read_s, self._heard_s[topic] = now_s, min(now_s, made_s)
        take(message)

    def leave_out(self) -> None:
        """Count a record that cannot be shown."""
        self._unreadable += 1

    def tick(self, now_s: float, *, kafka_away: str, rate: float) -> None:
        """Bring what changes by itself up to date, once a second or so.

        `kafka_away` says why Kafka does not answer, or ''; `rate` is how many random orders a
        minute the page sends.
        """
        self._now_s, self._kafka_away, self._rate = now_s, kafka_away, rate
        self._sections.change('health')
        self._sections.change('kpis')

    def newer(self, seen: dict[str, int]) -> bytes:
        """The sections that changed since; see `Sections.newer`."""
        return self._sections.newer(seen)

    @property
    def robots(self) -> frozenset[str]:
        """The robots that are known."""
        known = {state.serial_number for state in self._fleet.states}
        known.update(report.serial_number for report in self._report.robots)
        return frozenset(known.union(self._site.robots))

    # What comes in

    def _take_fleet(self, fleet: FleetState) -> None:
        if fleet.step != self._fleet.step:
            before = {state.serial_number: state.position for state in self._fleet.states}
            self._moved = frozenset(
                state.serial_number
                for state in fleet.states
                if before.get(state.serial_number, state.position) != state.position
            )
        self._fleet = fleet
        self._kpis.take_state(fleet)
        self._sections.change('floor')

    def _take_report(self, report: FleetReport) -> None:
        self._report = report
        self._kpis.take_report(report)
        self._sections.change('floor')

    def _take_open(self, orders: OpenOrders) -> None:
        self._open = orders
        for order in orders.orders:
            keep(self._orders, order.order_id, order, _KEPT_REQUESTS)
        self._sections.change('orders')

    def _take_tasks(self, tasks: Tasks) -> None:
        self._tasks = {task.task_id: task for task in tasks.tasks}
        self._sections.change('orders')

    def _take_assignments(self, assignments: Assignments) -> None:
        self._kpis.take_assignments(assignments)
        self._assignments = {a.serial_number: a for a in assignments.assignments}
        self._sections.change('floor')

    def _take_plans(self, plans: Plans) -> None:
        self._plans = plans
        self._kpis.take_plans(plans)
        self._sections.change('plans')

    def _take_validator(self, report: ValidatorReport) -> None:
        self._validator = report
        self._sections.change('validator')

    def _take_request(self, request: OrderRequest) -> None:
        request = short_request(request)
        self._intake.take_request(request, self._heard_s['warehouse.orders'], self._read_s)
        keep(self._requests, request.order_id, request, _KEPT_REQUESTS)

    def _take_command(self, command: OperatorCommand) -> None:
        """Remember what people have seen, and put where no robot may have found it yet."""
        cell = command.cell
        if command.command == 'acknowledge':
            self._acknowledge()
        elif cell is None:
            return
        elif command.command == 'blockCell' and self._site.is_on_map(cell):
            keep(self._placed, cell, None, _KEPT_PLACED)
            self._sections.change('floor')
        elif command.command == 'unblockCell':
            self._placed.pop(cell, None)
            self._sections.change('floor')

    def _acknowledge(self) -> None:
        """Remember by name: the list is cut at its length, and a validator may begin anew."""
        # One from before this page was there may not have meant the violations that it knows.
        is_old = self._heard_s['warehouse.commands'] < (self._begun_s or 0.0)
        if self._validator is not None and not is_old:
            self._acknowledged = frozenset(map(_violation_name, self._validator.violations))
            self._sections.change('validator')

    def _take_event(self, event: OrderEvent) -> None:
        event = short_event(event)
        self._kpis.take_event(event)
        self._intake.take_event(event, self._read_s)
        if event.line_id:
            lines = self._lines.get(event.order_id, {})
            if len(lines) < SHOWN_LINES:
                lines[event.line_id] = event
            keep(self._lines, event.order_id, lines, _KEPT_REQUESTS)
        elif event.is_end(was_received=self._was_received(event.order_id)):
            self._take_end(event)
        elif event.status is OrderStatus.RECEIVED:
            keep(self._received, event.order_id, event.time_s, _KEPT_REQUESTS)
        self._sections.change('orders')

    def _was_received(self, name: str) -> bool:
        ended = self._ended.get(name)
        was_taken = ended is not None and ended.row.status != OrderStatus.REJECTED
        return was_taken or name in self._received or name in self._orders

    def _take_end(self, end: OrderEvent) -> None:
        name = end.order_id
        order, request = self._orders.get(name), self._requests.get(name)
        lines, received_s = self._lines.get(name, {}), self._received.get(name)
        row = ended_row(end, order, request, lines, received_s)
        keep(self._ended, name, _Ended(row, msgspec.Raw(msgspec.json.encode(row))), _KEPT_ENDS)

    def _take_failure(self, event: FailureEvent) -> None:
        self._kpis.take_failure(event)
        events = self._failures.get(event.failure_id, {})
        if len(events) < _KEPT_EVENTS_OF_ONE or event.event == 'FailureResolved':
            events[event.event, event.time_s, event.response] = event
        if event.failure_id not in self._failures:
            keep(self._failures, event.failure_id, events, _KEPT_FAILURES)
        self._sections.change('failures')

    # What goes out

    def _robot_rows(self) -> list[RobotRow]:
        states = {state.serial_number: state for state in self._fleet.states}
        reports = {report.serial_number: report for report in self._report.robots}
        return [
            robot_row(
                states.get(name) or reports[name].state,
                reports.get(name),
                self._assignments.get(name),
                heard=name in states,
                moved=name in self._moved,
                cell_m=self._site.cell_m,
            )
            for name in sorted(states.keys() | reports.keys())
        ]

    def _floor_section(self) -> dict[str, Any]:
        return {
            'step': self._fleet.step,
            'robots': self._robot_rows(),
            'blocked': self._report.blocked,
            'placed': list(self._placed),
            'halted': self._report.halted,
            'faultyChargers': self._report.faulty_chargers,
        }

    def _plans_section(self) -> dict[str, Any]:
        return {'plans': {plan.serial_number: plan for plan in self._plans.plans}}

    def _orders_section(self) -> dict[str, Any]:
        rows = [order_row(order, self._tasks) for order in self._open.orders[:_SHOWN_OPEN]]
        still = {order.order_id for order in self._open.orders}
        return {
            'open': rows,
            'openCount': len(self._open.orders),
            # The end may be read before the last snapshot from when it was open.
            'ended': list(
                within(
                    _SHOWN_ENDED_BYTES,
                    (
                        end.encoded
                        for name, end in reversed(self._ended.items())
                        if name not in still
                    ),
                )
            ),
        }

    def _failures_section(self) -> list[Any]:
        return [failure_row(events.values()) for events in reversed(self._failures.values())]

    def _kpis_section(self) -> KpiView:
        return self._kpis.view(self._now_s, self._open.orders)

    def _validator_section(self) -> dict[str, Any]:
        assert self._validator is not None
        return {
            'checked': self._validator.checked,
            'violations': self._validator.violations[-_SHOWN_VIOLATIONS:],
            'broken': len(self._validator.violations),
            'unseen': [
                violation
                for violation in self._validator.violations
                if _violation_name(violation) not in self._acknowledged
            ][-_SHOWN_VIOLATIONS:],
        }

    def _health_section(self) -> dict[str, Any]:
        ages = {
            name: max(0.0, round(self._now_s - heard, 1)) for name, heard in self._heard_s.items()
        }
        return {
            'nowS': self._now_s,
            'kafkaAway': self._kafka_away,
            'ages': ages,
            'rate': self._rate,
            'unreadable': self._unreadable,
            'standstill': self._intake.standstill(self._open, self._now_s),
        }


_ViolationName = tuple[int, str, str]


def _violation_name(violation: Violation) -> _ViolationName:
    return violation.step, violation.rule, violation.description
