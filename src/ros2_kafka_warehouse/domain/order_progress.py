"""How an order stands and ends, by the tasks of its lines."""

from collections.abc import Iterable, Mapping
from typing import Final

from msgspec.structs import replace

from ros2_kafka_warehouse.messages.orders import (
    LineStatus,
    Order,
    OrderEvent,
    OrderLine,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.tasks import Assignments, Task, TaskStatus

_ETA_NEWS_S: Final = 5.0  # a smaller change of an ETA is no news
_LINE_ENDS: Final = {
    TaskStatus.DELIVERED: LineStatus.DELIVERED,
    TaskStatus.FAILED: LineStatus.FAILED,
    TaskStatus.CANCELLED: LineStatus.CANCELLED,
}
RANKS: Final = {
    status: rank
    for rank, status in enumerate(
        (
            OrderStatus.RECEIVED,
            OrderStatus.PLANNED,
            OrderStatus.ASSIGNED,
            OrderStatus.PICKING,
            OrderStatus.CARRYING,
        )
    )
}
_ORDER_STATUS: Final = {
    TaskStatus.OPEN: OrderStatus.PLANNED,
    TaskStatus.ASSIGNED: OrderStatus.ASSIGNED,
    TaskStatus.PICKING: OrderStatus.PICKING,
    TaskStatus.CARRIED: OrderStatus.CARRYING,
}


class Etas:
    """When each task should be delivered, by the newest assignments."""

    def __init__(self) -> None:
        self._etas: dict[str, float] = {}
        self._assignments: Assignments | None = None

    def note(self, assignments: Assignments | None) -> set[str]:
        """The orders whose tasks are expected at another time now."""
        if assignments is None or assignments is self._assignments:
            return set()
        self._assignments = assignments
        touched = set()
        etas: dict[str, float] = {}
        for assignment in assignments.assignments:
            for task_id, eta_s in zip(assignment.tasks, assignment.eta_s, strict=False):
                before = self._etas.get(task_id)
                if before is None or abs(before - eta_s) >= _ETA_NEWS_S:
                    touched.add(task_id.rpartition('/')[0])
                    before = eta_s
                etas[task_id] = before
        touched.update(name.rpartition('/')[0] for name in self._etas.keys() - etas.keys())
        self._etas = etas
        return touched

    def of(self, order: Order) -> float | None:
        """When the last of its lines should be delivered; None if that is open for one."""
        etas = [self._etas.get(task_id) for task_id in _open_tasks(order)]
        known = [eta_s for eta_s in etas if eta_s is not None]
        return max(known) if known and len(known) == len(etas) else None


def _open_tasks(order: Order) -> list[str]:
    """The tasks of the lines that have not ended."""
    return [
        f'{order.order_id}/{line.line_id}'
        for line in order.lines
        if line.status is LineStatus.OPEN
    ]


def advanced(
    order: Order, tasks: Mapping[str, Task], now_s: float
) -> tuple[Order, list[OrderEvent]]:
    """The order with its lines as their tasks stand now, and an event for each that has ended."""
    lines, events = [], []
    for line in order.lines:
        task = tasks.get(f'{order.order_id}/{line.line_id}')
        line_now = line if task is None else _line_now(line, task)
        if task is not None and line_now.status is not line.status:
            status = OrderStatus(line_now.status.value)
            event = OrderEvent(
                order.order_id,
                order.order_update_id,
                status,
                now_s,
                line.line_id,
                task.reason,
                task.robot,
            )
            events.append(event)
        lines.append(line_now)
    return replace(order, lines=tuple(lines)), events


def is_blocked(order: Order, tasks: Mapping[str, Task]) -> bool:
    """Whether each of its lines that has not ended waits for a person."""
    waiting = [tasks.get(task_id) for task_id in _open_tasks(order)]
    return all(task is not None and task.status is TaskStatus.BLOCKED for task in waiting)


def _line_now(line: OrderLine, task: Task) -> OrderLine:
    if line.status is not LineStatus.OPEN:
        return line
    status = _LINE_ENDS.get(task.status, LineStatus.OPEN)
    line = replace(line, place=task.pickup if task.stranded else None, attempt=task.attempt)
    if task.carried or status is LineStatus.DELIVERED:
        # A change that came too late: this is what has been picked.
        return replace(line, product=task.product, quantity=task.quantity, status=status)
    return line if status is LineStatus.OPEN else replace(line, status=status)


def end_of(order: Order) -> OrderStatus | None:
    """How an order has ended, or None."""
    ends = {line.status for line in order.lines}
    if LineStatus.OPEN in ends:
        return None
    if ends == {LineStatus.CANCELLED}:
        return OrderStatus.CANCELLED
    if LineStatus.DELIVERED not in ends:
        return OrderStatus.FAILED
    wanted = [line.status for line in order.lines if not line.withdrawn]
    if all(status is LineStatus.DELIVERED for status in wanted):
        return OrderStatus.DELIVERED
    return OrderStatus.PARTIAL


def status_of(order: Order, tasks: Iterable[Task]) -> OrderStatus:
    """Where an order stands that has not ended: as far as its farthest line."""
    states = {task.status for task in tasks} & {*_ORDER_STATUS, TaskStatus.BLOCKED}
    if not states:
        return order.status
    moving = [_ORDER_STATUS[status] for status in states if status is not TaskStatus.BLOCKED]
    if TaskStatus.BLOCKED in states and set(moving) <= {OrderStatus.PLANNED}:
        return OrderStatus.BLOCKED
    return max(moving, key=RANKS.__getitem__)


def summary(order: Order) -> str:
    """How many of its lines have ended how, where they have not all ended the same."""
    count = len(order.lines)
    parts = [
        f'{number} of {count} lines {status.value.lower()}'
        for status in (LineStatus.DELIVERED, LineStatus.CANCELLED, LineStatus.FAILED)
        if 0 < (number := sum(line.status is status for line in order.lines)) < count
    ]
    return ', '.join(parts)
