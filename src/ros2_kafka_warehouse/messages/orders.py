"""Orders: a customer asks, `orders` and `task_organizer` answer."""

from datetime import datetime
from enum import StrEnum
from typing import Final

from ros2_kafka_warehouse.messages.message import Cell, Message


class Line(Message, frozen=True):
    """One product of an order; becomes one task."""

    line_id: str
    product: str
    quantity: int = 1


class OrderRequest(Message, frozen=True):
    """What comes from the Kafka topic `warehouse.orders`.

    The same id and update with the same content again changes nothing; a lower update is
    refused, as is the same update with other content (VDA 5050, 6.1.4).
    """

    order_id: str
    order_update_id: int = 0
    station: str = ''
    lines: tuple[Line, ...] = ()
    priority: int = 0  # 0 to 9, the higher the sooner
    due_time: datetime | None = None
    cancel: bool = False


class OrderStatus(StrEnum):
    """Where an order stands. DELIVERED, PARTIAL, CANCELLED, FAILED and REJECTED are ends."""

    RECEIVED = 'RECEIVED'
    PLANNED = 'PLANNED'
    ASSIGNED = 'ASSIGNED'
    PICKING = 'PICKING'
    CARRYING = 'CARRYING'
    BLOCKED = 'BLOCKED'
    DELIVERED = 'DELIVERED'
    PARTIAL = 'PARTIAL'
    CANCELLED = 'CANCELLED'
    FAILED = 'FAILED'
    REJECTED = 'REJECTED'


# How an order ends that was taken; one that was not is REJECTED.
ORDER_ENDS: Final = frozenset(
    {OrderStatus.DELIVERED, OrderStatus.PARTIAL, OrderStatus.CANCELLED, OrderStatus.FAILED}
)


class LineStatus(StrEnum):
    """How the line of an order ended, or that it has not."""

    OPEN = 'OPEN'
    DELIVERED = 'DELIVERED'
    CANCELLED = 'CANCELLED'
    FAILED = 'FAILED'


class OrderLine(Message, frozen=True):
    """A line of an order that was accepted.

    Attributes:
        withdrawn: A later update no longer wants it.
        place: Where its load was left, if it no longer is in stock nor on a robot that works.
        attempt: That of its task. Both are the Task Organizer's memory, should it start again.
    """

    line_id: str
    product: str
    quantity: int = 1
    status: LineStatus = LineStatus.OPEN
    withdrawn: bool = False
    place: Cell | None = None
    attempt: int = 0


class Order(Message, frozen=True):
    """An order that was accepted and has not ended."""

    order_id: str
    order_update_id: int
    station: str
    lines: tuple[OrderLine, ...]
    released_s: float
    priority: int = 0
    due_s: float | None = None
    cancelled: bool = False
    status: OrderStatus = OrderStatus.RECEIVED
    eta_s: float | None = None


class OpenOrders(Message, frozen=True):
    """`/orders/open`: all orders that have not ended."""

    orders: tuple[Order, ...] = ()


class OrderEvent(Message, frozen=True):
    """`/orders/events`, and from there Kafka: a status that an order, or a line, has reached.

    `(order_id, order_update_id, line_id, status)` names an event: the same again is a repeat.
    The end of a line (`line_id` set) comes before the end of its order.
    """

    order_id: str
    order_update_id: int
    status: OrderStatus
    time_s: float
    line_id: str = ''
    reason: str = ''
    robot: str = ''
    eta_s: float | None = None
    late_s: float | None = None  # of an end: later than due, negative: sooner

    def is_end(self, *, was_received: bool) -> bool:
        """Whether the order, or the line, ends with it: a refused update ends nothing."""
        refused = self.status is OrderStatus.REJECTED and not was_received
        return refused or self.status in ORDER_ENDS
