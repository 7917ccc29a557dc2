"""A whole warehouse in its processes, as the integration tests start and shake it."""

import json
import os
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable
from functools import partial
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any, Self

from confluent_kafka import OFFSET_BEGINNING, Consumer, TopicPartition
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.site import Site, make_site
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport
from ros2_kafka_warehouse.messages.orders import LineStatus, OrderEvent, OrderRequest, OrderStatus
from ros2_kafka_warehouse.messages.robots import ActionStatus, FleetState
from ros2_kafka_warehouse.send import random_requests
from ros2_kafka_warehouse.topics import BRIDGE, TOPICS


class Warehouse:
    """`ros2-kafka-warehouse run` on a real Kafka, with no page, short steps and few robots."""

    def __init__(self, bench: Bench, *options: str, robots: int = 4, step_s: float = 0.1) -> None:
        self.bench = bench
        self.site: Site = make_site(robots, seed=0)
        self.logs = bench.place / 'logs'
        command = (
            sys.executable, '-m', 'ros2_kafka_warehouse', 'run', f'--robots={robots}',
            f'--step-s={step_s}',
            f'--bootstrap-servers={bench.bootstrap_servers}', '--port=0', f'--logs={self.logs}',
            *options,
        )  # fmt: skip
        self.process = Process(list(command), bench.place / 'run.log', bench.environ)
        self.process.start()
        self._readers: dict[str, _Reader] = {}
        self._found: dict[str, list[Any]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for reader in self._readers.values():
            reader.close()
        if self.process.running:
            self.process.send(signal.SIGTERM)
            self.process.wait(90)

    def wait_until_up(self) -> None:
        """Wait until all parts do their work."""
        self.process.wait_for('the warehouse is up', 120)

    # Processes

    def pids(self, name: str) -> list[int]:
        """The numbers of the processes that a part has had."""
        found = re.findall(rf' {name} is (?:process|started again, as process) (\d+)', self.said())
        return [int(pid) for pid in found]

    def kill(self, *names: str) -> None:
        """SIGKILL parts, and wait until each is started again and does its work."""
        before = {name: (self.pids(name), self._times_ready(name)) for name in names}
        for pids, _ in before.values():
            os.kill(pids[-1], signal.SIGKILL)
        for name, (pids, times) in before.items():
            eventually(partial(self._is_back, name, len(pids), times), 60, self.story)

    def _is_back(self, name: str, starts: int, times_ready: int) -> bool:
        return len(self.pids(name)) > starts and self._times_ready(name) > times_ready

    def _times_ready(self, name: str) -> int:
        ready = ' runs ' if name == 'bridge' else ': works'
        return (self.logs / f'{name}.log').read_text().count(ready)

    def said(self) -> str:
        """What `ros2-kafka-warehouse run` has printed, and the ends of the logs of its parts."""
        return self.process.output()

    def story(self) -> str:
        """The ends of all logs, for the message of a test that fails."""
        logs = sorted(self.logs.glob('*.log'))
        ends = [f'== {log.name}\n' + '\n'.join(_tail(log)) for log in logs]
        return '\n'.join([self.said(), *ends])

    # Orders

    def requests(self, count: int, seed: int = 0) -> list[OrderRequest]:
        """Random orders."""
        return list(islice(random_requests(self.site, Random(seed)), count))  # noqa: S311

    def send(self, requests: Iterable[OrderRequest]) -> None:
        """Put orders into Kafka."""
        for request in requests:
            self.bench.produce(
                'warehouse.orders', [encode(request).encode()], key=request.order_id
            )

    def command(self, command: OperatorCommand) -> None:
        """Put a command into Kafka."""
        self.bench.produce('warehouse.commands', [encode(command).encode()])

    def events(self) -> list[OrderEvent]:
        """All events of orders that Kafka holds now, repeats left out."""
        found = self._all('warehouse.order-events', OrderEvent)
        unique = {(e.order_id, e.order_update_id, e.line_id, e.status): e for e in reversed(found)}
        return list(reversed(unique.values()))

    def ends(self) -> dict[str, OrderStatus]:
        """How each order has ended that has."""
        events = [event for event in self.events() if not event.line_id]
        received = {e.order_id for e in events if e.status is OrderStatus.RECEIVED}
        return {
            e.order_id: e.status for e in events if e.is_end(was_received=e.order_id in received)
        }

    def wait_for_ends(self, requests: Iterable[OrderRequest], timeout_s: float = 120) -> None:
        """Wait until each of these orders has ended."""
        wanted = {request.order_id for request in requests}
        eventually(
            lambda: wanted <= self.ends().keys(),
            timeout_s,
            lambda: f'open: {sorted(wanted - self.ends().keys())}\n{self.story()}',
        )

    def assert_each_line_was_delivered_once(self, requests: Iterable[OrderRequest]) -> None:
        """In the events, on the floor, and by the word of the validator."""
        wanted = Counter(
            f'{request.order_id}/{line.line_id}' for request in requests for line in request.lines
        )
        eventually(lambda: self.delivered() == wanted.keys(), 60, self.story)
        # One too many may be on its way: give it the time to show.
        self._all('warehouse.robots', FleetState, longer_s=0.5)
        told = Counter(
            f'{event.order_id}/{event.line_id}'
            for event in self.events()
            if event.line_id and event.status.value == LineStatus.DELIVERED.value
        )
        assert told == wanted, self.story()
        assert self.delivered() == wanted.keys(), self.story()
        dropped = Counter(map(_load_of, self.drops()))
        assert dropped <= wanted, self.story()
        assert self.violations() == [], self.story()

    def delivered(self) -> set[str]:
        """The loads that were put down: seen, or by the book that a simulated floor keeps."""
        fleets = self._all('warehouse.robots', FleetState)
        books = {book for fleet in fleets if (book := fleet.floor.get('floor'))}
        kept = {load for book in books for load in json.loads(book).get('delivered', [])}
        return kept | set(map(_load_of, self.drops()))

    def drops(self) -> set[str]:
        """The drops that Kafka has seen robots finish, by the ids of the actions.

        A snapshot that nobody could take while the bridge or Kafka was away is gone.
        """
        return {
            action.action_id
            for fleet in self._all('warehouse.robots', FleetState)
            for state in fleet.states
            for action in state.action_states
            if action.action_type == 'drop' and action.action_status is ActionStatus.FINISHED
        }

    def violations(self) -> list[str]:
        """The rules that were broken, by the validator's word."""
        return [
            f'{violation.step}: {violation.rule}: {violation.description}'
            for report in self._all('warehouse.validator', ValidatorReport)
            for violation in report.violations
        ]

    def _all(self, topic: str, kind: type, longer_s: float = 0.0) -> list[Any]:
        """All that a topic holds now, and what comes for a while; each is read only once."""
        found = self._found.setdefault(topic, [])
        if end := self.bench.end_offset(topic):
            if topic not in self._readers:
                self._readers[topic] = _Reader(self.bench.bootstrap_servers, topic)
            values = self._readers[topic].read_to(end, longer_s)
            found += [decode(value, kind) for value in values]
        return found


class _Reader:
    """Reads the only partition of a topic onwards from its beginning."""

    def __init__(self, bootstrap_servers: str, topic: str) -> None:
        config = {
            'bootstrap.servers': bootstrap_servers,
            'group.id': 'test',
            'enable.auto.commit': False,
            'reconnect.backoff.max.ms': 500,
        }
        self._consumer = Consumer(config)
        self._consumer.assign([TopicPartition(topic, 0, OFFSET_BEGINNING)])
        self._next = 0

    def read_to(self, end: int, longer_s: float, timeout_s: float = 60.0) -> list[bytes]:
        """The values up to an offset and of a while longer, but for those read before."""
        values: list[bytes] = []
        deadline = time.monotonic() + timeout_s
        while self._next < end:
            assert time.monotonic() < deadline, f'{self._next} of {end} records could be read'
            values += self._read(0.05)
        if longer_s:
            values += self._read(longer_s)
        return values

    def _read(self, timeout_s: float) -> list[bytes]:
        records = [it for it in self._consumer.consume(1000, timeout_s) if it.error() is None]
        if records:
            self._next = int(records[-1].offset() or 0) + 1
        return [record.value() or b'' for record in records]

    def close(self) -> None:
        """Leave the topic."""
        self._consumer.close()


def _load_of(action_id: str) -> str:
    return action_id.rpartition('#')[0]


def _tail(log: Path) -> list[str]:
    return log.read_text(errors='replace').splitlines()[-12:]


BRIDGE_NODE = 'kafka_bridge_warehouse'
Graph = dict[str, dict[str, list[str]]]


def running_graph(bench: Bench, site: Site) -> Graph:
    """Who publishes and who subscribes to each drawn topic, by a node that looks."""
    with bench.script('ros_graph.py', '60', *drawn_graph(site)) as reader:
        assert reader.wait(90) == 0, reader.output()
        found = json.loads(reader.output())
    assert isinstance(found, dict)
    return found


def drawn_graph(site: Site) -> Graph:
    """The graph as `ros2_kafka_warehouse.topics`, and so the drawings, have it."""
    robots = [name.replace('-', '_') for name in site.robots]
    return {
        name: {'publishers': _nodes(topic.publishers), 'subscribers': _nodes(topic.subscribers)}
        for topic in TOPICS
        for name in (
            [topic.name.replace('<robot>', robot) for robot in robots]
            if '<robot>' in topic.name
            else [topic.name]
        )
    }


def _nodes(modules: tuple[str, ...]) -> list[str]:
    return sorted(BRIDGE_NODE if name == BRIDGE else name for name in modules)
