"""Orders: takes what customers ask for, once each, and tells how it goes on and ends.

The desk decides nothing about loads. What it wants (a line withdrawn, an order cancelled) stands
in `OpenOrders`; what has become of it the Task Organizer says in `Tasks`, and the desk reports.
"""

from collections.abc import Iterable
from typing import Final

from msgspec.structs import replace

from ros2_kafka_warehouse.domain.order_progress import (
    RANKS,
    Etas,
    advanced,
    end_of,
    is_blocked,
    status_of,
    summary,
)
from ros2_kafka_warehouse.domain.order_requests import (
    answer,
    changed,
    new_order,
    too_late,
    unusable,
    wrong,
)
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.orders import (
    ORDER_ENDS,
    LineStatus,
    OpenOrders,
    Order,
    OrderEvent,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.tasks import Assignments, Task, Tasks, TaskStatus

_ENDED_KEPT: Final = 100_000  # ended and refused orders whose repeats are still known as such
MAX_OPEN: Final = 200  # orders at a time
BLOCKED_TIMES: Final = 5  # as many orders as usual, at most, while some wait for a person


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
        self._etas = Etas()

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
        if reason := unusable(request):  # nothing is kept of it: it may be megabytes
            return (answer(request, OrderStatus.REJECTED, now_s, reason),)
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
            return (answer(request, OrderStatus.REJECTED, now_s, reason),)
        record.update = request.order_update_id
        if record.order is None:
            record.order = new_order(request, now_s)
            record.status, record.rank = OrderStatus.RECEIVED, 0
            self._open[request.order_id] = record
            self._over.pop(request.order_id, None)
        elif request.cancel:
            record.order = replace(record.order, order_update_id=record.update, cancelled=True)
        else:
            record.order = changed(record.order, new_order(request, now_s))
        self._snapshot = None
        reason = 'to be cancelled' if request.cancel else ''
        return (answer(request, OrderStatus.RECEIVED, now_s, reason),)

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
        bad = wrong(request, self._site)
        if record.order is not None:
            is_picking = record.rank >= RANKS[OrderStatus.PICKING]
            bad = bad or too_late(record.order, request, is_picking=is_picking)
        return f'VALIDATION_FAILURE: {bad}' if bad else ''

    # What becomes of the orders.

    def follow(
        self, tasks: Tasks, assignments: Assignments | None, now_s: float
    ) -> tuple[OrderEvent, ...]:
        """What has happened to the orders, by the newest snapshots of tasks and assignments."""
        if tasks is self._tasks and assignments is self._assignments:
            return ()
        touched = self._note_tasks(tasks) | self._etas.note(assignments)
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

    def _advance(self, record: _Record, now_s: float) -> list[OrderEvent]:
        assert record.order is not None
        before = record.order
        tasks = self._seen_tasks.get(before.order_id, {})
        order, events = advanced(before, tasks, now_s)
        if is_blocked(order, tasks):
            self._blocked.add(order.order_id)
        else:
            self._blocked.discard(order.order_id)
        status = end_of(order) or status_of(order, tasks.values())
        order = replace(order, status=status, eta_s=self._etas.of(order))
        if order != before:
            record.order = order
            self._snapshot = None
        if status is not record.status:
            events += self._report(record, order, now_s)
        return events

    def _report(self, record: _Record, order: Order, now_s: float) -> list[OrderEvent]:
        """The event of a new status, unless an order only goes back to wait for its next line."""
        before, record.status = record.status, order.status
        rank = RANKS.get(order.status, record.rank)
        is_news = order.status not in RANKS or rank > record.rank or before not in RANKS
        record.rank = max(rank, record.rank)
        if not is_news:
            return []
        reason, late_s = '', None
        if order.status in ORDER_ENDS:
            reason = summary(order)
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
        if unusable(request):
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
        record.rank = RANKS.get(order.status, 0)
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
            record.rank = max(record.rank, RANKS.get(event.status, record.rank))
