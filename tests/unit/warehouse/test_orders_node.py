"""What the Orders node keeps beside its desk, and what it makes of what Kafka has kept."""

import logging
from collections.abc import Callable
from math import inf
from threading import Event
from types import SimpleNamespace
from typing import Any

import pytest

from ros2_kafka_warehouse import kafka
from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.domain.site import read_site
from ros2_kafka_warehouse.messages.orders import (
    Line,
    LineStatus,
    OpenOrders,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.nodes import orders
from ros2_kafka_warehouse.nodes.orders import Asked, Ended, Memory, memory_of

OPEN = OpenOrders(
    (
        Order('A', 0, 'packing-1', (OrderLine('1', 'tea'), OrderLine('2', 'rice')), 1.0),
        Order('B', 0, 'packing-1', (OrderLine('1', 'tea'),), 1.0),
    )
)
LINE = OrderEvent('A', 0, OrderStatus.DELIVERED, 2.0, '2')
END = OrderEvent('A', 0, OrderStatus.DELIVERED, 2.0)


def test_an_ended_order_stays_open_for_the_others_until_kafka_has_its_end() -> None:
    ended = Ended()
    ended.note((LINE, END), OPEN)
    left = OpenOrders(OPEN.orders[1:])
    kept = ended.with_those(left)
    assert [order.order_id for order in kept.orders] == ['B', 'A']
    assert kept.orders[1].status is OrderStatus.DELIVERED
    assert kept.orders[1].lines[1].status is LineStatus.DELIVERED
    ended.confirm(LINE)
    ended.confirm(OrderEvent('A', 0, OrderStatus.RECEIVED, 1.0))
    assert ended.with_those(left) == kept
    ended.confirm(END)
    assert ended.with_those(left) is left


def test_an_order_is_never_named_twice() -> None:
    ended = Ended()
    ended.note((END,), OPEN)
    assert len(ended.with_those(OPEN).orders) == 2


# Memory


def asked(name: str, offset: int, partition: int = 0, *, is_brought: bool = True) -> Asked:
    request = OrderRequest(name, 0, 'packing-1', (Line('1', 'rice'),))
    return Asked(request, partition, offset, float(offset), is_brought)


def names(requests: tuple[OrderRequest, ...]) -> list[str]:
    return [request.order_id for request in requests]


def restart(memory: Memory) -> tuple[list[str], list[str]]:
    """The orders that are open after a restart, and those of which something is said anew."""
    desk = OrderDesk(read_site())
    said = desk.restore(
        memory.requests, memory.events, 100.0, past=memory.past, orders=memory.orders
    )
    return [order.order_id for order in desk.open().orders], [event.order_id for event in said]


def test_orders_whose_events_kafka_no_longer_has_do_not_come_back() -> None:
    requests = [asked(name, offset) for offset, name in enumerate('abcdef')]
    events = [
        OrderEvent('c', 0, OrderStatus.DELIVERED, 30.0),
        OrderEvent('d', 0, OrderStatus.RECEIVED, 31.0),
        OrderEvent('d', 0, OrderStatus.DELIVERED, 32.0),
        OrderEvent('e', 0, OrderStatus.RECEIVED, 33.0),
    ]
    order = Order('b', 0, 'packing-1', (OrderLine('1', 'rice'),), 1.0)
    memory = memory_of(requests, events, 30.0, OpenOrders((order,)))
    assert names(memory.past) == ['a', 'b', 'c']
    # f was never answered, however long it waited; b is open still; e was kept whole.
    assert restart(memory) == (['b', 'e', 'f'], ['f'])


def test_an_order_that_kafka_itself_no_longer_has_goes_on() -> None:
    order = Order('old', 0, 'packing-1', (OrderLine('1', 'rice'),), 1.0)
    other = Order('site', 0, 'nowhere', (OrderLine('1', 'rice'),), 1.0)
    memory = memory_of([], [], -inf, OpenOrders((order, other)))
    assert restart(memory) == (['old'], [])


def test_where_a_partition_has_no_answer_the_time_of_the_oldest_event_decides() -> None:
    requests = [
        asked('ended', 10, 1),
        asked('waits', 11, 1, is_brought=False),
        asked('young', 60, 2),
    ]
    events = [OrderEvent('else', 0, OrderStatus.RECEIVED, 50.0)]
    memory = memory_of(requests, events, 50.0, OpenOrders())
    assert names(memory.past) == ['ended']
    assert names(memory.requests) == ['waits', 'young']


def test_without_any_event_all_that_came_is_taken() -> None:
    requests = [asked('a', 0), asked('b', 1)]
    assert restart(memory_of(requests, [], -inf, OpenOrders())) == (['a', 'b'], ['a', 'b'])


def test_a_module_that_cannot_remember_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    works: list[Callable[[], None]] = []
    asks = Event()
    timer = SimpleNamespace(cancel=lambda: None)

    def each_s(_period_s: float, look: Callable[[], None]) -> Any:
        works.append(look)
        return timer

    def fail(*_: Any) -> None:
        raise OSError('the disk is gone')

    module: Any = SimpleNamespace(
        site=read_site(),
        node=SimpleNamespace(count_publishers=lambda _topic: 1),
        settings=SimpleNamespace(bootstrap_servers='127.0.0.1:9'),
        log=logging.getLogger('orders'),
        newest=lambda *_: SimpleNamespace(or_none=None),
        each=lambda *_, **__: None,
        speaker=lambda _topic: None,
        work_on=works.append,
        at_end=lambda _callback: None,
        each_s=each_s,
        ask=asks.set,
    )
    monkeypatch.setattr(kafka, 'newest', fail)
    orders.start(module)
    work, look = works
    look()
    assert asks.wait(30)
    with pytest.raises(OSError, match='the disk is gone'):
        work()
