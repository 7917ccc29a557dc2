"""What became of a simulation: how each order ended, and whether any was lost or doubled."""

from typing import NamedTuple

from ros2_kafka_warehouse.domain.kpis import KpiView
from ros2_kafka_warehouse.messages.onlookers import Violation
from ros2_kafka_warehouse.messages.orders import OrderEvent, OrderStatus


class Result(NamedTuple):
    """What became of a simulation.

    Attributes:
        ended: How each order ended: its id, and the status.
        lost: Orders that were sent, and have neither ended nor are open.
        doubled: Orders and lines that ended more than once.
    """

    steps: int
    now_s: float
    sent: int
    ended: dict[str, OrderStatus]
    open: tuple[str, ...]
    lost: tuple[str, ...]
    doubled: tuple[str, ...]
    violations: tuple[Violation, ...]
    kpis: KpiView

    @property
    def is_right(self) -> bool:
        """Whether no rule was broken and no order lost or doubled."""
        return not (self.violations or self.lost or self.doubled)


class Ends:
    """How orders and lines ended; the same event again is a repeat, another one too many."""

    def __init__(self) -> None:
        self.ended: dict[str, OrderStatus] = {}
        self.doubled: list[str] = []
        self._received: set[str] = set()
        self._events: dict[tuple[str, str], tuple[int, OrderStatus]] = {}

    def take(self, event: OrderEvent) -> None:
        """The next event."""
        if event.status is OrderStatus.RECEIVED:
            self._received.add(event.order_id)
        if not event.is_end(was_received=event.order_id in self._received):
            return
        end = (event.order_update_id, event.status)
        known = self._events.setdefault((event.order_id, event.line_id), end)
        if known != end:
            self.doubled.append(f'{event.order_id}/{event.line_id}'.rstrip('/'))
        elif not event.line_id:
            self.ended[event.order_id] = event.status
