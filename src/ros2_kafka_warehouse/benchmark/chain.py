"""The whole chain, measured: Kafka -> bridge -> modules -> robots, with real processes.

Two questions. How long does one order take until a robot has it, and until that robot moves, when
there is little to do? And how many orders a second come through from Kafka to a robot, when as
many come at once as there are robots?
"""

import logging
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

import msgspec
from confluent_kafka import Message
from rich.console import Console
from rich.table import Table

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.site import Site, make_site
from ros2_kafka_warehouse.kafka import Memory, Sender
from ros2_kafka_warehouse.messages.orders import Line, OrderEvent, OrderRequest, OrderStatus
from ros2_kafka_warehouse.messages.robots import FleetState, RobotState

_EVENTS: Final = 'warehouse.order-events'
_STATES: Final = 'warehouse.robots'
_UP_S: Final = 180.0
_LOOK_S: Final = 0.2
_PATIENCE_S: Final = 120.0
_ASSIGNED: Final = frozenset(
    (OrderStatus.ASSIGNED, OrderStatus.PICKING, OrderStatus.CARRYING, OrderStatus.DELIVERED)
)
_HEAVIEST_KG: Final = 20.0  # that every type of robot carries


class Spread(msgspec.Struct, frozen=True):
    """Seconds: of half of the orders, of nearly all, of the slowest."""

    median_s: float
    p99_s: float
    most_s: float


class ChainResult(msgspec.Struct, frozen=True):
    """What was measured.

    Attributes:
        robots: Of the site.
        step_s: Of the robots: they move at steps only, so that a move comes after one or two.
        orders: Sent one after the other, and then so many at once.
        to_assigned: From the record in Kafka until a robot has the order, as Orders says.
        to_event: Until Kafka has the event that says so.
        to_move: Until the robot has left its cell.
        orders_per_s: Of those that came at once: until the last one was assigned.
        cpu_share: Of one core, by process, while they came one after the other.
    """

    robots: int
    step_s: float
    orders: int
    to_assigned: Spread
    to_event: Spread
    to_move: Spread
    orders_per_s: float
    cpu_share: dict[str, float]


def measure(
    bootstrap_servers: str | None, robots: int, step_s: float, orders: int, pause_s: float
) -> ChainResult:
    """Run a warehouse of its own and send orders through it.

    Args:
        bootstrap_servers: A real Kafka that no other warehouse uses; None for the embedded one.
        robots: Of the site.
        step_s: Seconds of a step.
        orders: How many are sent one after the other.
        pause_s: Between these.

    Raises:
        TimeoutError: The warehouse did not come up, or an order was not assigned.
    """
    site = make_site(robots, 0)
    with ExitStack() as stack:
        floor = stack.enter_context(_running(bootstrap_servers, robots, step_s))
        log = logging.getLogger(__name__)
        record = _Record(stack.enter_context(Memory(floor.servers, (_EVENTS, _STATES), log)))
        sender = stack.enter_context(Sender(floor.servers))
        cpu_before, began_s = _cpu_s(floor.pids), time.monotonic()
        slow = _send(sender, _requests(site, 'one', orders), pause_s)
        record.wait(slow, lambda: record.moved)
        record.wait(slow, lambda: record.ended)
        cpu, took_s = _cpu_s(floor.pids), time.monotonic() - began_s
        burst = _send(sender, _requests(site, 'burst', robots), 0.0)
        record.wait(burst, lambda: record.told)
        assigned_s = max(record.assigned[name] for name in burst)
        return ChainResult(
            robots=robots,
            step_s=step_s,
            orders=orders,
            to_assigned=_spread([record.assigned[n] - at for n, at in slow.items()]),
            to_event=_spread([record.told[n] - at for n, at in slow.items()]),
            to_move=_spread([record.moved[n] - at for n, at in slow.items()]),
            orders_per_s=round(len(burst) / (assigned_s - min(burst.values())), 1),
            cpu_share={n: round((cpu[n] - cpu_before[n]) / took_s, 3) for n in cpu_before},
        )


def rows(result: ChainResult) -> Iterator[tuple[str, str]]:
    """The result as a table of two columns."""
    yield 'robots', str(result.robots)
    yield 'seconds of a step', f'{result.step_s:g}'
    for name, spread in (
        ('order in Kafka -> a robot has it', result.to_assigned),
        ('order in Kafka -> the event is in Kafka', result.to_event),
        ('order in Kafka -> the robot moves', result.to_move),
    ):
        yield (
            f'{name}, s (median / 99th / most)',
            f'{spread.median_s:.3f} / {spread.p99_s:.3f} / {spread.most_s:.3f}',
        )
    yield (
        f'orders/s from Kafka to a robot, {result.robots} at once',
        f'{result.orders_per_s:,.1f}',
    )
    for name, share in sorted(result.cpu_share.items(), key=lambda item: -item[1]):
        yield f'share of a core while they come singly: {name}', f'{share:.2f}'


class _Floor(NamedTuple):
    servers: str
    pids: dict[str, int]


@contextmanager
def _running(bootstrap_servers: str | None, robots: int, step_s: float) -> Iterator[_Floor]:
    """A warehouse of its own; ends with the `with`."""
    command = [
        sys.executable, '-m', 'ros2_kafka_warehouse', 'run', f'--robots={robots}',
        f'--step-s={step_s}',
        '--port=0',
    ]  # fmt: skip
    if bootstrap_servers is not None:
        command.append(f'--bootstrap-servers={bootstrap_servers}')
    with tempfile.TemporaryFile('w+') as output:
        process = subprocess.Popen(command, stdout=output, stderr=output)  # noqa: S603 (our own)
        try:
            text = _wait_until_up(process, output)
            yield _Floor(bootstrap_servers or _embedded(text), _pids(text))
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(60)


def _wait_until_up(process: subprocess.Popen[bytes], output: Any) -> str:
    deadline_s = time.monotonic() + _UP_S
    while time.monotonic() < deadline_s and process.poll() is None:
        output.seek(0)
        text = str(output.read())
        if 'the warehouse is up' in text:
            return text
        time.sleep(_LOOK_S)
    output.seek(0)
    raise TimeoutError(f'the warehouse does not come up:\n{output.read()}')


def _embedded(text: str) -> str:
    return text.partition('broker answers at ')[2].split()[0]


def _pids(text: str) -> dict[str, int]:
    found = (line.split() for line in text.splitlines() if ' is process ' in line)
    return {words[1]: int(words[-1]) for words in found}


def _requests(site: Site, stem: str, count: int) -> Iterator[OrderRequest]:
    """Orders of one line that every robot can carry."""
    random = Random(0)  # noqa: S311 (the same orders each time)
    names = [
        p.name for p in site.products.values() if p.size == 'small' and p.weight_kg < _HEAVIEST_KG
    ]
    unique = time.time_ns() % 10**9
    for number in range(count):
        line = Line('L1', random.choice(names))
        station = random.choice(sorted(site.stations))
        yield OrderRequest(f'{stem}-{unique}-{number}', 0, station, (line,))


def _send(sender: Sender, requests: Iterator[OrderRequest], pause_s: float) -> dict[str, float]:
    """Send orders; returns when each was sent, in seconds since the epoch."""
    sent = {}
    for request in requests:
        sent[request.order_id] = time.time()
        sender.send('warehouse.orders', request.order_id, encode(request))
        sender.serve(pause_s)
    sender.flush()
    return sent


class _Record:
    """What Kafka says of the orders, read while they are under way.

    Attributes:
        assigned: When each order was assigned, by the clock of Orders.
        told: When that was in Kafka.
        moved: When its robot had left the cell where it got the order.
    """

    def __init__(self, memory: Memory) -> None:
        self.assigned: dict[str, float] = {}
        self.told: dict[str, float] = {}
        self.moved: dict[str, float] = {}
        self.ended: set[str] = set()
        self._memory = memory
        self._starts: dict[str, str] = {}  # order -> the cell where its robot got it
        for _ in memory.replay():  # of others, before
            pass

    def wait(self, names: Collection[str], seen: Callable[[], Collection[str]]) -> None:
        """Read until all of these orders are among those that are seen."""
        deadline_s = time.monotonic() + _PATIENCE_S
        while missing := set(names) - set(seen()):
            if time.monotonic() > deadline_s:
                raise TimeoutError(f'{len(missing)} orders are not done, such as {missing.pop()}')
            record = self._memory.poll(_LOOK_S)
            if record is not None:
                self._take(record)

    def _take(self, record: Message) -> None:
        at_s = record.timestamp()[1] / 1000
        value = record.value() or b''
        if record.topic() == _EVENTS:
            self._take_event(decode(value, OrderEvent), at_s)
        else:
            for state in decode(value, FleetState).states:
                self._take_state(state, at_s)

    def _take_event(self, event: OrderEvent, at_s: float) -> None:
        name = event.order_id
        if event.status in _ASSIGNED and name not in self.assigned:
            self.assigned[name] = event.time_s
            self.told[name] = at_s
        if event.status is OrderStatus.DELIVERED and not event.line_id:
            self.ended.add(name)

    def _take_state(self, state: RobotState, at_s: float) -> None:
        name = state.order_id.partition('/')[0]
        if '/' not in state.order_id or name in self.moved:
            return
        start = self._starts.setdefault(name, state.last_node_id)
        acts = any(action.action_id.startswith(name) for action in state.action_states)
        if state.driving or acts or start != state.last_node_id:
            self.moved[name] = at_s


def _spread(values: Collection[float]) -> Spread:
    ordered = sorted(values)
    return Spread(
        round(ordered[len(ordered) // 2], 3),
        round(ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], 3),
        round(ordered[-1], 3),
    )


def _cpu_s(pids: dict[str, int]) -> dict[str, float]:
    """The processor time that each process has used, in seconds."""
    used = {}
    for name, pid in pids.items():
        with suppress(OSError):
            fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
            used[name] = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    return used


def run(
    bootstrap_servers: str | None,
    robots: int,
    step_s: float,
    orders: int,
    pause_s: float,
    json: Path | None,
) -> int:
    """Measure, show the table, and write the result as JSON where that is asked for.

    Returns the exit status: 1 where the warehouse did not come up or an order was not assigned.
    """
    try:
        result = measure(bootstrap_servers, robots, step_s, orders, pause_s)
    except TimeoutError as error:
        print(f'ros2-kafka-warehouse: {error}', file=sys.stderr)  # noqa: T201 (for the user)
        return 1
    table = Table('', 'measured', box=None)
    for row in rows(result):
        table.add_row(*row)
    Console().print(table)
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(result)))
    return 0
