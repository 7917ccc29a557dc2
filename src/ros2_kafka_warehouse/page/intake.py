"""Whether the desk of the orders still answers those that come to Kafka."""

from collections import OrderedDict
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.orders import BLOCKED_TIMES, MAX_OPEN
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.orders import OpenOrders, OrderEvent, OrderRequest, OrderStatus

_PATIENCE_S: Final = 10.0
# A desk that is full lets orders wait in Kafka; those that wait for a person do not count. The
# snapshot is a moment old: a few less are many, too.
_MANY_OPEN: Final = MAX_OPEN * 9 // 10
_MOST_OPEN: Final = _MANY_OPEN * BLOCKED_TIMES  # those that wait for a person, too
_KEPT_WAITING: Final = 2000
_KEPT_ANSWERED: Final = 20_000

_Name = tuple[str, int]


class Standstill(Message, frozen=True):
    """No order has been answered for a while, though some wait: `since_s` the first one."""

    count: int
    since_s: float


class _Asked(NamedTuple):
    made_s: float
    read_s: float


class Intake:
    """Compares the requests with the events of orders, which may be read in any order."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[_Name, _Asked] = OrderedDict()
        self._answered: OrderedDict[_Name, None] = OrderedDict()
        self._answered_to_s = 0.0  # the newest request that was answered
        self._moved_s = 0.0

    def take_request(self, request: OrderRequest, made_s: float, now_s: float) -> None:
        """A request was read, of a record that was made at `made_s`."""
        name = (request.order_id, request.order_update_id)
        if name in self._answered:
            self._answer_to(made_s)
        elif made_s > self._answered_to_s and name not in self._waiting:
            self._waiting[name] = _Asked(made_s, now_s)
            if len(self._waiting) > _KEPT_WAITING:
                self._waiting.popitem(last=False)

    def take_event(self, event: OrderEvent, now_s: float) -> None:
        """An event was read: it may be the answer to a request."""
        if event.line_id or event.status not in (OrderStatus.RECEIVED, OrderStatus.REJECTED):
            return
        name = (event.order_id, event.order_update_id)
        self._moved_s = now_s
        self._answered[name] = None
        self._answered.move_to_end(name)
        if len(self._answered) > _KEPT_ANSWERED:
            self._answered.popitem(last=False)
        if (asked := self._waiting.get(name)) is not None:
            self._answer_to(asked.made_s)

    def standstill(self, opened: OpenOrders, now_s: float) -> Standstill | None:
        """What there is to warn of, if anything."""
        if _is_full(opened):
            self._moved_s = now_s  # it has a moment to go on, once it is no longer
        if not self._waiting:
            return None
        first = next(iter(self._waiting.values()))
        if now_s - max(first.read_s, self._moved_s) < _PATIENCE_S:
            return None
        return Standstill(len(self._waiting), min(it.made_s for it in self._waiting.values()))

    def _answer_to(self, made_s: float) -> None:
        """What came before one that was answered was dealt with, too: a repeat has no answer."""
        if made_s > self._answered_to_s:
            self._answered_to_s = made_s
            for name, it in list(self._waiting.items()):
                if it.made_s <= made_s:
                    del self._waiting[name]


def _is_full(opened: OpenOrders) -> bool:
    count = len(opened.orders)
    blocked = sum(order.status is OrderStatus.BLOCKED for order in opened.orders)
    return count - blocked >= _MANY_OPEN or count >= _MOST_OPEN
