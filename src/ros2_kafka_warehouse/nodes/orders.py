"""Orders: takes the orders of customers, and says what becomes of each.

Its memory is Kafka. When it starts it reads again which orders came and how they ended. An order
that has ended stays open for the others until Kafka holds its end: whatever dies before that, the
end is said again, and nothing is carried twice.

Kafka need not keep all of it. An order is known to have ended by its events, or, when these are
gone, because a later one of its partition was answered and `warehouse.open-orders` does not name
it: `warehouse.order-events` should be kept for longer than `warehouse.orders`, and both for longer
than any order takes. `ros2-kafka-warehouse run` makes the topics with 14 and 7 days.

While the desk is full it takes nothing: DDS, the bridge and Kafka keep what waits.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from math import inf
from queue import SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from ros2_kafka_warehouse.codec import MessageError, decode
from ros2_kafka_warehouse.domain.order_requests import shortened
from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.orders import (
    ORDER_ENDS,
    LineStatus,
    OpenOrders,
    Order,
    OrderEvent,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.tasks import Assignments, Tasks
from ros2_kafka_warehouse.nodes.node import Gate, Module

if TYPE_CHECKING:
    from confluent_kafka import Message as Record

_REQUESTS: Final = 'warehouse.orders'
_EVENTS: Final = 'warehouse.order-events'
_OPEN: Final = 'warehouse.open-orders'
_GROUP: Final = 'warehouse.orders'  # of the bridge that brings the orders
_MORE: Final = 400  # orders that the bridge has brought, and perhaps not yet committed
_UNTOLD: Final = 200  # orders whose end Kafka does not have: then no more are taken
_LOOK_S: Final = 0.1
_SAY_S: Final = 5.0
_ANSWERS: Final = frozenset((OrderStatus.RECEIVED, OrderStatus.REJECTED))
_LINE_ENDS: Final = frozenset(LineStatus) - {LineStatus.OPEN}


def start(module: Module) -> None:
    """Remember, then take orders."""
    _Orders(module)


class Asked(NamedTuple):
    """A request, and where Kafka has it.

    Attributes:
        time_s: Of its record.
        is_brought: The bridge has brought it here.
    """

    request: OrderRequest
    partition: int
    offset: int
    time_s: float
    is_brought: bool


class Memory(NamedTuple):
    """What the desk is told when it starts again; see `OrderDesk.restore`."""

    requests: tuple[OrderRequest, ...] = ()
    events: tuple[OrderEvent, ...] = ()
    past: tuple[OrderRequest, ...] = ()
    orders: tuple[Order, ...] = ()


class _Restored(NamedTuple):
    number: int
    missing: tuple[OrderEvent, ...]


def memory_of(
    asked: Sequence[Asked], events: Sequence[OrderEvent], since_s: float, before: OpenOrders
) -> Memory:
    """What is to be remembered of what Kafka has kept.

    Args:
        asked: In the order in which they came, in each partition.
        events: All that are kept.
        since_s: The time of the oldest record of these.
        before: What was open when it was last said.
    """
    answers = {
        (event.order_id, event.order_update_id)
        for event in events
        if not event.line_id and event.status in _ANSWERS
    }
    answered_to = _answered_to(asked, answers)
    requests: list[OrderRequest] = []
    past: list[OrderRequest] = []
    for it in asked:
        request = it.request
        # Those of a partition come in order: what came before one that was answered, was, too.
        end = answered_to.get(it.partition)
        is_old = it.is_brought and it.time_s < since_s if end is None else it.offset < end
        is_known = (request.order_id, request.order_update_id) in answers
        (past if is_old and not is_known else requests).append(request)
    old = {request.order_id for request in past}
    kept = {request.order_id for request in requests}
    orders = [
        order for order in before.orders if order.order_id in old or order.order_id not in kept
    ]
    return Memory(tuple(requests), tuple(events), tuple(past), tuple(orders))


def _answered_to(asked: Sequence[Asked], answers: set[tuple[str, int]]) -> dict[int, int]:
    """By partition, the last request that was answered; of a repeat the first one counts."""
    answered_to: dict[int, int] = {}
    seen: set[tuple[str, int]] = set()
    for it in asked:
        name = (it.request.order_id, it.request.order_update_id)
        if name in answers and name not in seen:
            seen.add(name)
            answered_to[it.partition] = max(it.offset, answered_to.get(it.partition, 0))
    return answered_to


class _Named(Message, frozen=True):
    """What a request that cannot be read may still say."""

    order_id: str
    order_update_id: int = 0


class _Orders:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._desk = OrderDesk(module.site)
        self._ended = Ended()
        self._remembers = False
        self._took = True
        self._news: SimpleQueue[_Restored | OrderEvent | BaseException] = SimpleQueue()
        self._tasks = module.newest('/tasks', Tasks)
        self._assignments = module.newest('/assignments', Assignments)
        module.each(
            '/orders/incoming',
            OrderRequest,
            self._receive,
            gate=Gate(self._takes),
            refuse=self._refuse,
        )
        self._open = module.speaker('/orders/open')
        self._events = module.speaker('/orders/events')
        module.work_on(self._work)
        self._stopped = Event()
        module.at_end(self._stopped.set)
        self._waited_s = 0.0
        self._timer = module.each_s(_LOOK_S, self._wait_for_bridge)

    def _takes(self) -> bool:
        return self._remembers and not self._desk.is_full and len(self._ended) < _UNTOLD

    # Memory

    def _wait_for_bridge(self) -> None:
        """Begin to remember once the bridge is there: what comes later comes here by itself."""
        if self._module.node.count_publishers('/orders/incoming') == 0:
            self._waited_s += _LOOK_S
            if self._waited_s >= _SAY_S:
                self._waited_s = 0.0
                self._module.log.info('waits for the bridge')
            return
        self._timer.cancel()
        if not self._module.settings.bootstrap_servers:
            self._module.log.warning('no Kafka is named: what came before is not remembered')
            self._tell(_Restored(0, ()))
            return
        Thread(target=self._remember, name='memory', daemon=True).start()

    def _remember(self) -> None:
        """Read what Kafka has, then go on reading what is said; in a thread."""
        try:
            self._read_kafka()
        except BaseException as error:  # noqa: BLE001 (the module ends by it, in its own thread)
            self._tell(error)

    def _tell(self, news: '_Restored | OrderEvent | BaseException') -> None:
        self._news.put(news)
        self._module.ask()

    def _read_kafka(self) -> None:
        from ros2_kafka_warehouse import kafka  # noqa: PLC0415 (only where there is a Kafka)

        log, stopped = self._module.log, self._stopped.is_set
        servers = self._module.settings.bootstrap_servers
        # Before the events: an order that is open here, and ended since, has its end there.
        value = kafka.newest(servers, _OPEN, log, stopped)
        before = OpenOrders()
        if value is not None:
            with suppress(MessageError):
                before = decode(value, OpenOrders)
        with kafka.Memory(servers, (_REQUESTS, _EVENTS), log, stopped) as reader:
            came = kafka.committed(servers, _GROUP, _REQUESTS, log, stopped)
            remembered = _read(reader.replay(), came, before)
            if stopped():
                return
            # Here and not in the module's thread, which is to say that it is alive meanwhile.
            missing = self._desk.restore(
                remembered.requests,
                remembered.events,
                self._module.now_s(),
                past=remembered.past,
                orders=remembered.orders,
            )
            self._tell(_Restored(len(remembered.requests) + len(remembered.past), missing))
            for record in reader.follow(_EVENTS):
                with suppress(MessageError):
                    self._tell(decode(record.value() or b'', OrderEvent))

    # Work

    def _work(self) -> None:
        for news in self._taken_news():
            if isinstance(news, OrderEvent):
                self._ended.confirm(news)
            elif isinstance(news, _Restored):
                self._begin(news)
            else:
                raise news
        if not self._remembers:
            return
        if self._tasks.or_none is not None:
            now_s = self._module.now_s()
            self._say(self._desk.follow(self._tasks.value, self._assignments.or_none, now_s))
        self._open.say(self._ended.with_those(self._desk.open()))
        self._say_whether_it_takes()

    def _taken_news(self) -> Iterator[_Restored | OrderEvent | BaseException]:
        while not self._news.empty():
            yield self._news.get()

    def _begin(self, restored: _Restored) -> None:
        self._say(restored.missing)
        self._remembers = True
        self._module.log.info(
            'remembers %d orders that came, %d are open',
            restored.number,
            len(self._desk.open().orders),
        )

    def _receive(self, request: OrderRequest) -> None:
        self._say(self._desk.receive(request, self._module.now_s()))
        self._module.ask()

    def _refuse(self, text: str, error: MessageError) -> None:
        """Answer a text that is no order, if it names one at all."""
        with suppress(msgspec.DecodeError):
            named = msgspec.json.decode(text, type=_Named)
            self._events.say(
                OrderEvent(
                    order_id=shortened(named.order_id),
                    order_update_id=named.order_update_id,
                    status=OrderStatus.REJECTED,
                    time_s=self._module.now_s(),
                    reason=str(error),
                )
            )

    def _say(self, events: tuple[OrderEvent, ...]) -> None:
        if not events:
            return
        if self._module.settings.bootstrap_servers:
            self._ended.note(events, self._open_before)
        for event in events:
            self._events.say(event)

    def _say_whether_it_takes(self) -> None:
        takes = self._takes()
        if takes != self._took:
            self._took = takes
            words = 'takes orders again' if takes else 'the desk is full: orders wait in Kafka'
            self._module.log.info(words)

    @property
    def _open_before(self) -> OpenOrders:
        said = self._open.said
        return said if isinstance(said, OpenOrders) else OpenOrders()


def _read(records: 'Iterable[Record]', came: dict[int, int], before: OpenOrders) -> Memory:
    """What is to be remembered of the records of both topics.

    What the bridge has not brought yet is left in Kafka, or the desk would be overrun.
    """
    asked: list[Asked] = []
    events: list[OrderEvent] = []
    since_s = inf
    for record in records:
        value, time_s = record.value() or b'', record.timestamp()[1] / 1000
        with suppress(MessageError):  # was refused when it came
            if record.topic() == _EVENTS:
                since_s = min(since_s, time_s)
                events.append(decode(value, OrderEvent))
                continue
            partition, offset = record.partition() or 0, record.offset() or 0
            ahead = offset - came.get(partition, 0)
            if ahead < _MORE:
                request = decode(value, OrderRequest)
                asked.append(Asked(request, partition, offset, time_s, ahead < 0))
    return memory_of(asked, events, since_s if events else -inf, before)


class Ended:
    """Orders that have ended, and of which Kafka does not have the end yet."""

    def __init__(self) -> None:
        self._orders: dict[str, Order] = {}

    def __len__(self) -> int:
        return len(self._orders)

    def note(self, events: tuple[OrderEvent, ...], before: OpenOrders) -> None:
        """Keep the orders that these events end, as they were when they were open.

        Args:
            events: What has just been found.
            before: What was said to be open before.
        """
        ends = {
            event.order_id: event
            for event in events
            if not event.line_id and event.status in ORDER_ENDS
        }
        for order in before.orders if ends else ():
            if order.order_id in ends:
                event = ends[order.order_id]
                self._orders[order.order_id] = msgspec.structs.replace(
                    order,
                    order_update_id=event.order_update_id,
                    status=event.status,
                    lines=tuple(_ended_lines(order, events)),
                )

    def confirm(self, event: OrderEvent) -> None:
        """Kafka has this event."""
        held = self._orders.get(event.order_id)
        if held is not None and not event.line_id and event.status is held.status:
            del self._orders[event.order_id]

    def with_those(self, orders: OpenOrders) -> OpenOrders:
        """These orders and those that are open; the same value where there are none."""
        if not self._orders:
            return orders
        open_ids = {order.order_id for order in orders.orders}
        kept = (held for name, held in self._orders.items() if name not in open_ids)
        return OpenOrders((*orders.orders, *kept))


def _ended_lines(order: Order, events: tuple[OrderEvent, ...]) -> Iterator[msgspec.Struct]:
    ends = {
        event.line_id: event.status.value
        for event in events
        if event.order_id == order.order_id and event.line_id
    }
    for line in order.lines:
        end = ends.get(line.line_id, '')
        yield (
            msgspec.structs.replace(line, status=LineStatus(end)) if end in _LINE_ENDS else line
        )
