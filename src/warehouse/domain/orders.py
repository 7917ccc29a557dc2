"""Orders: takes what customers ask for, once each, and tells how it goes on and ends.

The desk decides nothing about loads. What it wants (a line withdrawn, an order cancelled) stands
in `OpenOrders`; what has become of it the Task Organizer says in `Tasks`, and the desk reports.
"""

from collections.abc import Iterable
from datetime import UTC
from typing import Final

from msgspec.structs import replace

from warehouse.domain.site import Site
from warehouse.messages import (
    ORDER_ENDS,
    Assignments,
    Line,
    LineStatus,
    OpenOrders,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
    Task,
    Tasks,
    TaskStatus,
)

__all__ = ['BLOCKED_TIMES', 'MAX_OPEN', 'OrderDesk', 'event_name', 'shortened']

_ENDED_KEPT: Final = 100_000  # ended and refused orders whose repeats are still known as such
_MOST_LINES: Final = 100
MAX_OPEN: Final = 200  # orders at a time
BLOCKED_TIMES: Final = 5  # as many orders as usual, at most, while some wait for a person
_ETA_NEWS_S: Final = 5.0  # a smaller change of an ETA is no news
_PRIORITIES: Final = range(10)
_UPDATES: Final = range(2**32)  # uint32 in VDA 5050
_QUANTITIES: Final = range(1, 10_001)
_ID_LENGTH: Final = 200
_REASON_LENGTH: Final = 500

_LINE_ENDS: Final = {
    TaskStatus.DELIVERED: LineStatus.DELIVERED,
    TaskStatus.FAILED: LineStatus.FAILED,
    TaskStatus.CANCELLED: LineStatus.CANCELLED,
}
_RANKS: Final = {
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


def event_name(event: OrderEvent) -> tuple[str, int, str, OrderStatus]:
    """What two events have in common of which the second is a repeat."""
    return event.order_id, event.order_update_id, event.line_id, event.status


class _Record:
    """What the desk knows of one order id.

    Attributes:
        order: The order, while it is open.
        update: The update that was accepted last, or None.
        status: How it stands, or how it ended.
        rank: How far it had come; going back is no news.
        seen: Hashes of all requests, so that a repeat is known as one.
    """

    __slots__ = ('order', 'rank', 'seen', 'status', 'update')

    def __init__(self) -> None:
        self.order: Order | None = None
        self.update: int | None = None
        self.status = OrderStatus.REJECTED
        self.rank = -1
        self.seen: set[int] = set()


class OrderDesk:
    """Takes orders for a site.

    Args:
        site: With the products and stations that there are.
        max_open: Orders at a time; with so many the desk `is_full`, and wants no more. Orders of
            which every line is blocked do not count, but there are never more than five times
            as many.
    """

    def __init__(self, site: Site, max_open: int = MAX_OPEN) -> None:
        self._site = site
        self._max_open = max_open
        self._records: dict[str, _Record] = {}
        self._open: dict[str, _Record] = {}
        self._over: dict[str, None] = {}  # in the order in which they ended or were refused
        self._blocked: set[str] = set()
        self._snapshot: OpenOrders | None = OpenOrders()
        self._tasks: Tasks | None = None
        self._assignments: Assignments | None = None
        self._seen_tasks: dict[str, dict[str, Task]] = {}
        self._etas: dict[str, float] = {}

    @property
    def is_full(self) -> bool:
        """Whether no more orders should be taken now."""
        count = len(self._open)
        return (
            count - len(self._blocked) >= self._max_open or count >= self._max_open * BLOCKED_TIMES
        )

    def open(self) -> OpenOrders:
        """All orders that have not ended; the same value again if nothing has changed."""
        if self._snapshot is None:
            orders = (record.order for record in self._open.values())
            self._snapshot = OpenOrders(tuple(order for order in orders if order is not None))
        return self._snapshot

    # What comes from customers.

    def receive(self, request: OrderRequest, now_s: float) -> tuple[OrderEvent, ...]:
        """Takes a request; the same again, at any time, does nothing.

        A new order and each change of it is RECEIVED, or REJECTED with the reason. That a change
        was rejected leaves the order as it was.
        """
        if reason := _unusable(request):  # nothing is kept of it: it may be megabytes
            return (_event(request, OrderStatus.REJECTED, now_s, reason),)
        record = self._records.setdefault(request.order_id, _Record())
        content = hash(request)
        if content in record.seen:
            return ()
        record.seen.add(content)
        if reason := self._refusal(record, request):
            if reason.startswith('NO_ORDER_TO_CANCEL'):
                # The order itself may come late; it is not wanted any more.
                record.update, record.status = request.order_update_id, OrderStatus.CANCELLED
            if record.order is None:
                self._retire(request.order_id)
            return (_event(request, OrderStatus.REJECTED, now_s, reason),)
        record.update = request.order_update_id
        if record.order is None:
            record.order = self._new(request, now_s)
            record.status, record.rank = OrderStatus.RECEIVED, 0
            self._open[request.order_id] = record
            self._over.pop(request.order_id, None)
        elif request.cancel:
            record.order = replace(record.order, order_update_id=record.update, cancelled=True)
        else:
            record.order = _changed(record.order, self._new(request, now_s))
        self._snapshot = None
        reason = 'to be cancelled' if request.cancel else ''
        return (_event(request, OrderStatus.RECEIVED, now_s, reason),)

    def _refusal(self, record: _Record, request: OrderRequest) -> str:
        update = request.order_update_id
        if record.update is not None:
            if update < record.update:
                return f'OUTDATED_ORDER_UPDATE: update {record.update} was received before'
            if update == record.update:
                return 'SAME_ORDER_UPDATE_ID: this update was received with other content'
            if record.order is None:
                is_known = record.status is not OrderStatus.REJECTED
                return f'ORDER_ENDED: the order is {record.status if is_known else "over"}'
            if record.order.cancelled:
                return 'ORDER_UPDATE_FOLLOWING_CANCEL: the order is to be cancelled'
        if request.cancel:
            return '' if record.order else 'NO_ORDER_TO_CANCEL: no such order was received'
        wrong = self._wrong(request) or _too_late(record, request)
        return f'VALIDATION_FAILURE: {wrong}' if wrong else ''

    def _wrong(self, request: OrderRequest) -> str:
        """What is wrong with an order, or ''."""
        if request.station not in self._site.stations:
            known = ', '.join(self._site.stations)
            return f'no station is called {request.station!r}; there are {known}'
        if not 0 < len(request.lines) <= _MOST_LINES:
            return f'an order needs at least one line, and has at most {_MOST_LINES}'
        if request.priority not in _PRIORITIES:
            return f'priority is {request.priority}; it goes from 0 to 9'
        line_ids = [line.line_id for line in request.lines]
        if len(set(line_ids)) < len(line_ids):
            return 'two lines have the same lineId'
        return next((wrong for line in request.lines if (wrong := self._wrong_line(line))), '')

    def _wrong_line(self, line: Line) -> str:
        if not 0 < len(line.line_id) <= _ID_LENGTH or '/' in line.line_id:
            return f"lineId must have 1 to {_ID_LENGTH} characters and no '/'"
        if line.product not in self._site.products:
            return f'line {line.line_id}: no product is called {line.product!r}'
        if line.quantity not in _QUANTITIES:
            return f'line {line.line_id}: quantity must be from 1 to {_QUANTITIES[-1]}'
        return ''

    def _new(self, request: OrderRequest, now_s: float) -> Order:
        due = request.due_time
        if due is not None and due.tzinfo is None:
            due = due.replace(tzinfo=UTC)
        return Order(
            order_id=request.order_id,
            order_update_id=request.order_update_id,
            station=request.station,
            lines=tuple(
                OrderLine(line.line_id, line.product, line.quantity) for line in request.lines
            ),
            released_s=now_s,
            priority=request.priority,
            due_s=None if due is None else due.timestamp(),
        )

    # What becomes of the orders.

    def follow(
        self, tasks: Tasks, assignments: Assignments | None, now_s: float
    ) -> tuple[OrderEvent, ...]:
        """What has happened to the orders, by the newest snapshots of tasks and assignments."""
        if tasks is self._tasks and assignments is self._assignments:
            return ()
        touched = self._note_tasks(tasks) | self._note_etas(assignments)
        self._tasks, self._assignments = tasks, assignments
        events: list[OrderEvent] = []
        for order_id in sorted(touched):
            if order_id in self._open:
                events += self._advance(self._open[order_id], now_s)
        return tuple(events)

    def _note_tasks(self, tasks: Tasks) -> set[str]:
        """The orders whose tasks have changed."""
        touched = set()
        for task in tasks.tasks:
            seen = self._seen_tasks.setdefault(task.order_id, {})
            if seen.get(task.task_id) != task or task.order_id not in self._open:
                seen[task.task_id] = task
                touched.add(task.order_id)
        for order_id in touched - self._open.keys():
            del self._seen_tasks[order_id]
        return touched

    def _note_etas(self, assignments: Assignments | None) -> set[str]:
        """The orders whose tasks are expected at another time now."""
        if assignments is None or assignments is self._assignments:
            return set()
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

    def _advance(self, record: _Record, now_s: float) -> list[OrderEvent]:
        assert record.order is not None
        before = record.order
        tasks = self._seen_tasks.get(before.order_id, {})
        events: list[OrderEvent] = []
        lines = []
        for line in before.lines:
            task = tasks.get(f'{before.order_id}/{line.line_id}')
            line_now = line if task is None else _line_now(line, task)
            if task is not None and line_now.status is not line.status:
                status = OrderStatus(line_now.status.value)
                events.append(
                    OrderEvent(
                        before.order_id,
                        before.order_update_id,
                        status,
                        now_s,
                        line.line_id,
                        task.reason,
                        task.robot,
                    )
                )
            lines.append(line_now)
        order = replace(before, lines=tuple(lines))
        self._note_blocked(order, tasks)
        status = _end(order) or _status(order, tasks.values())
        order = replace(order, status=status, eta_s=self._eta_s(order))
        if order != before:
            record.order = order
            self._snapshot = None
        if status is not record.status:
            events += self._report(record, order, now_s)
        return events

    def _note_blocked(self, order: Order, tasks: dict[str, Task]) -> None:
        waiting = [
            tasks.get(f'{order.order_id}/{line.line_id}')
            for line in order.lines
            if line.status is LineStatus.OPEN
        ]
        if all(task is not None and task.status is TaskStatus.BLOCKED for task in waiting):
            self._blocked.add(order.order_id)
        else:
            self._blocked.discard(order.order_id)

    def _report(self, record: _Record, order: Order, now_s: float) -> list[OrderEvent]:
        """The event of a new status, unless an order only goes back to wait for its next line."""
        before, record.status = record.status, order.status
        rank = _RANKS.get(order.status, record.rank)
        is_news = order.status not in _RANKS or rank > record.rank or before not in _RANKS
        record.rank = max(rank, record.rank)
        if not is_news:
            return []
        reason, late_s = '', None
        if order.status in ORDER_ENDS:
            reason = _summary(order)
            late_s = None if order.due_s is None else now_s - order.due_s
            self._close(record)
        elif order.status is OrderStatus.BLOCKED:
            tasks = self._seen_tasks.get(order.order_id, {}).values()
            reasons = (task.reason for task in tasks if task.status is TaskStatus.BLOCKED)
            reason = next((reason for reason in reasons if reason), '')
        return [
            OrderEvent(
                order.order_id,
                order.order_update_id,
                order.status,
                now_s,
                reason=reason,
                eta_s=order.eta_s,
                late_s=late_s,
            )
        ]

    def _close(self, record: _Record) -> None:
        assert record.order is not None
        order_id = record.order.order_id
        record.order = None
        self._snapshot = None
        del self._open[order_id]
        self._blocked.discard(order_id)
        self._seen_tasks.pop(order_id, None)
        self._retire(order_id)

    def _retire(self, order_id: str) -> None:
        """Keeps an order that is over, for its repeats, and forgets the one that is longest so."""
        self._over.pop(order_id, None)
        self._over[order_id] = None
        if len(self._over) > _ENDED_KEPT:
            oldest = next(iter(self._over))
            del self._over[oldest], self._records[oldest]

    def _eta_s(self, order: Order) -> float | None:
        """When the last of its lines should be delivered; None if that is open for one."""
        etas = [
            self._etas.get(f'{order.order_id}/{line.line_id}')
            for line in order.lines
            if line.status is LineStatus.OPEN
        ]
        known = [eta_s for eta_s in etas if eta_s is not None]
        return max(known) if known and len(known) == len(etas) else None

    # After a restart.

    def restore(
        self,
        requests: Iterable[OrderRequest],
        events: Iterable[OrderEvent],
        now_s: float = 0.0,
        *,
        past: Iterable[OrderRequest] = (),
        orders: Iterable[Order] = (),
    ) -> tuple[OrderEvent, ...]:
        """Knows again what a desk knew that received these requests and said these events.

        Both may hold repeats. Requests that were never answered are taken now; returned are the
        events that were never said.

        Args:
            requests: In the order in which they came.
            events: In the order in which they were said.
            now_s: The time.
            past: Requests that were answered, and whose events are no longer known: they are over,
            orders: unless they belong to these, which go on as they stood.
        """
        for request in past:
            self._know(request)
        reopened = {
            order.order_id: order.order_update_id for order in orders if self._reopen(order)
        }
        said: dict[tuple[str, int, str, OrderStatus], OrderEvent] = {}
        for event in events:
            said.setdefault(event_name(event), event)
        waiting: dict[str, list[OrderEvent]] = {}
        for event in said.values():
            waiting.setdefault(event.order_id, []).append(event)
        missing: list[OrderEvent] = []
        for request in requests:
            order_id, update = request.order_id, request.order_update_id
            self._replay(order_id, waiting.get(order_id, []), update)
            received = said.get((order_id, update, '', OrderStatus.RECEIVED))
            if order_id in reopened and update <= reopened[order_id]:
                self._records.setdefault(order_id, _Record()).seen.add(hash(request))
                continue
            time_s = now_s if received is None else received.time_s
            missing += self.receive(request, time_s)
        for order_id, rest in waiting.items():
            self._replay(order_id, rest, None)
        return tuple(event for event in missing if event_name(event) not in said)

    def _know(self, request: OrderRequest) -> None:
        """Notes a request of an order that is over, nobody knows how."""
        if _unusable(request):
            return
        record = self._records.setdefault(request.order_id, _Record())
        record.seen.add(hash(request))
        record.update = max(request.order_update_id, record.update or 0)
        self._retire(request.order_id)

    def _reopen(self, order: Order) -> bool:
        """Goes on with an order as it stood; says whether it is of this site."""
        site = self._site
        if order.station not in site.stations or any(
            line.product not in site.products for line in order.lines
        ):
            return False
        record = self._records.setdefault(order.order_id, _Record())
        record.order, record.update = order, order.order_update_id
        record.status = OrderStatus.RECEIVED if order.status in ORDER_ENDS else order.status
        record.rank = _RANKS.get(order.status, 0)
        self._open[order.order_id] = record
        self._over.pop(order.order_id, None)
        self._snapshot = None
        return True

    def _replay(self, order_id: str, events: list[OrderEvent], below: int | None) -> None:
        """Applies the events that were said before a request, and takes them from the list.

        They name a lower update, one that has been accepted: a request that was refused may have
        come before one of a lower update, and what was said of that one waits for it.

        Args:
            order_id: Whose.
            events: Of this order, in the order in which they were said.
            below: The update of the request; None takes all.
        """
        record = self._records.get(order_id)
        accepted = None if record is None else record.update
        rest = []
        for event in events:
            update = event.order_update_id
            if below is not None and (accepted is None or update > accepted or update >= below):
                rest.append(event)
            elif record is not None and record.order is not None:
                self._apply(record, record.order, event)
        events[:] = rest

    def _apply(self, record: _Record, order: Order, event: OrderEvent) -> None:
        if event.line_id:
            status = LineStatus(event.status.value)
            record.order = replace(
                order,
                lines=tuple(
                    replace(line, status=status) if line.line_id == event.line_id else line
                    for line in order.lines
                ),
            )
            self._snapshot = None
        elif event.status in ORDER_ENDS:
            record.status = event.status
            self._close(record)
        else:
            record.rank = max(record.rank, _RANKS.get(event.status, record.rank))


def _event(
    request: OrderRequest, status: OrderStatus, now_s: float, reason: str = ''
) -> OrderEvent:
    return OrderEvent(
        shortened(request.order_id),
        request.order_update_id,
        status,
        now_s,
        reason=shortened(reason, _REASON_LENGTH),
    )


def shortened(text: str, length: int = _ID_LENGTH) -> str:
    """A text of a customer as it is repeated to everybody who looks on."""
    return text if len(text) <= length else f'{text[: length - 1]}…'


def _unusable(request: OrderRequest) -> str:
    """Why a request does not even name an order, or ''."""
    if not 0 < len(request.order_id) <= _ID_LENGTH:
        return f'VALIDATION_FAILURE: orderId must have 1 to {_ID_LENGTH} characters'
    if request.order_update_id not in _UPDATES:
        return f'VALIDATION_FAILURE: orderUpdateId goes from 0 to {_UPDATES[-1]}'
    return ''


def _too_late(record: _Record, request: OrderRequest) -> str:
    """Why an order can no longer be changed so, or ''.

    It must follow from what was asked and said alone, or a desk that remembers would answer
    otherwise than before.
    """
    order = record.order
    if order is None:
        return ''
    is_picked = record.rank >= _RANKS[OrderStatus.PICKING] or any(
        line.status is LineStatus.DELIVERED for line in order.lines
    )
    if is_picked and request.station != order.station:
        return f'the station is still {order.station!r}: loads are on their way there'
    withdrawn = {line.line_id for line in order.lines if line.withdrawn}
    again = next((line.line_id for line in request.lines if line.line_id in withdrawn), None)
    if again is not None:
        return f'line {again} was withdrawn by an earlier update: give it another lineId'
    return ''


def _changed(order: Order, wanted: Order) -> Order:
    """The order with a later update: lines that have ended stay, others are as wanted now.

    A line that is no longer wanted is withdrawn; if its load is on its way already, it comes.
    """
    new = {line.line_id: line for line in wanted.lines}
    lines = [
        line if line.status is not LineStatus.OPEN else _changed_line(line, new.get(line.line_id))
        for line in order.lines
    ]
    known = {line.line_id for line in order.lines}
    lines += [line for line in wanted.lines if line.line_id not in known]
    return replace(wanted, lines=tuple(lines), released_s=order.released_s, status=order.status)


def _changed_line(line: OrderLine, wanted: OrderLine | None) -> OrderLine:
    if wanted is None:
        return replace(line, withdrawn=True)
    return replace(line, product=wanted.product, quantity=wanted.quantity, withdrawn=False)


def _line_now(line: OrderLine, task: Task) -> OrderLine:
    if line.status is not LineStatus.OPEN:
        return line
    status = _LINE_ENDS.get(task.status, LineStatus.OPEN)
    line = replace(line, place=task.pickup if task.stranded else None, attempt=task.attempt)
    if task.carried or status is LineStatus.DELIVERED:
        # A change that came too late: this is what has been picked.
        return replace(line, product=task.product, quantity=task.quantity, status=status)
    return line if status is LineStatus.OPEN else replace(line, status=status)


def _end(order: Order) -> OrderStatus | None:
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


def _status(order: Order, tasks: Iterable[Task]) -> OrderStatus:
    """Where an order stands that has not ended: as far as its farthest line."""
    states = {task.status for task in tasks} & {*_ORDER_STATUS, TaskStatus.BLOCKED}
    if not states:
        return order.status
    moving = [_ORDER_STATUS[status] for status in states if status is not TaskStatus.BLOCKED]
    if TaskStatus.BLOCKED in states and set(moving) <= {OrderStatus.PLANNED}:
        return OrderStatus.BLOCKED
    return max(moving, key=_RANKS.__getitem__)


def _summary(order: Order) -> str:
    count = len(order.lines)
    parts = [
        f'{number} of {count} lines {status.value.lower()}'
        for status in (LineStatus.DELIVERED, LineStatus.CANCELLED, LineStatus.FAILED)
        if 0 < (number := sum(line.status is status for line in order.lines)) < count
    ]
    return ', '.join(parts)
