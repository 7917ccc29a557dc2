"""A shop with a desk for orders, and what tests ask of it."""

from typing import Any

from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.domain.site import read_site
from ros2_kafka_warehouse.messages.orders import Line, Order, OrderEvent, OrderRequest, OrderStatus
from ros2_kafka_warehouse.messages.tasks import Assignments, Task, Tasks, TaskStatus

SITE = read_site()
ENDS = {OrderStatus.DELIVERED, OrderStatus.PARTIAL, OrderStatus.FAILED, OrderStatus.CANCELLED}


def request(order_id: str = 'a', update: int = 0, **more: Any) -> OrderRequest:
    more.setdefault('lines', (Line('1', 'coffee'), Line('2', 'rice', 2)))
    return OrderRequest(order_id, update, more.pop('station', 'packing-1'), **more)


def task(order: str, line: str, status: TaskStatus, **more: Any) -> Task:
    more.setdefault('product', 'coffee' if line == '1' else 'rice')
    more.setdefault('quantity', 1 if line == '1' else 2)
    more.setdefault('carried', status is TaskStatus.CARRIED)
    return Task(
        task_id=f'{order}/{line}',
        order_id=order,
        line_id=line,
        weight_kg=1.0,
        pickup=(5, 1),
        delivery=(41, 2),
        released_s=0.0,
        status=status,
        **more,
    )


def said(events: tuple[OrderEvent, ...]) -> list[tuple[str, OrderStatus]]:
    return [(event.line_id, event.status) for event in events]


class Shop:
    """A desk, and the tasks that its orders have become."""

    def __init__(self) -> None:
        self.desk = OrderDesk(SITE)
        self.tasks: dict[str, Task] = {}
        self.assignments: Assignments | None = None

    def ask(self, asked: OrderRequest, now_s: float = 1.0) -> list[tuple[str, OrderStatus]]:
        return said(self.desk.receive(asked, now_s))

    def now(self, *tasks: Task, now_s: float = 2.0) -> tuple[OrderEvent, ...]:
        self.tasks |= {it.task_id: it for it in tasks}
        snapshot = Tasks(1, tuple(self.tasks.values()))
        return self.desk.follow(snapshot, self.assignments, now_s)

    def order(self) -> Order:
        (order,) = self.desk.open().orders
        return order
