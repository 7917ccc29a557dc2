"""A topic of ROS in memory: its readers, the graph that shows them, and a node's writers to it."""

from __future__ import annotations

from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, field
from threading import Lock
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.qos import profile

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.graph import Graph

KIND: Final = 'acme_msgs/msg/Crane'
OURS: Final = 'RIHS01_aa'
ROOM: Final = 5
RELIABLE: Final = ('reliable', 'misreads', 'unnamed', 'bridge', 'foreign')
MATCHING: Final = (*RELIABLE, 'best effort')
READERS: Final = (*MATCHING, 'other type', 'other qos')
DISCOVERY_S: Final = 3 / 1024
_FULL: Final = 'cannot publish data, at ./publisher.c:1'
_QOS: Final = {
    'best effort': QoS(reliability='best_effort'),
    'other qos': QoS(durability='transient_local'),
}
_NAMES: Final = {'unnamed': '_NODE_NAME_UNKNOWN_', 'bridge': 'kafka_bridge_other'}


@dataclass(eq=False)
class Reader:
    """A reader of the topic.

    Args:
        number: Which of all that have ever been.
        kind: One of `READERS`.
        met_at_s: When a writer and it find each other.
        is_dead: Whether it is, and yet nobody may be told.
        told_at_s: When that is told, where it is dead.
    """

    number: int
    kind: str
    met_at_s: float
    is_dead: bool = False
    told_at_s: float = 0.0

    @property
    def node(self) -> str:
        return f'/{_NAMES.get(self.kind, f"reader_{self.number}")}'

    @property
    def holder(self) -> str:
        return 'a reader that is no ROS node' if self.kind == 'unnamed' else self.node

    def info(self) -> SimpleNamespace:
        """What the graph tells of it."""
        return SimpleNamespace(
            node_namespace='/',
            node_name=self.node[1:],
            topic_type='acme_msgs/msg/Hook' if self.kind == 'other type' else KIND,
            endpoint_gid=[1, 0x10 if self.kind == 'foreign' else 0x0F] + 14 * [self.number],
            qos_profile=profile(_QOS.get(self.kind, QoS())),
            topic_type_hash='RIHS01_bb' if self.kind in {'misreads', 'bridge'} else OURS,
        )


class Handle(nullcontext['Writer']):
    """What rclpy holds of a publisher while it is used."""

    def publish_raw(self, cdr: bytes) -> None:
        self.enter_result.write(cdr)


class Writer:
    """A publisher, and its history: a sample stays until all its reliable readers have it.

    Args:
        dds: Where it writes.
        room: Of the history; None where nothing bounds it.
    """

    def __init__(self, dds: Dds, room: int | None) -> None:
        self.dds = dds
        self._room = room
        self.samples = 0
        self.got: dict[Reader, int] = {}  # how far each has acknowledged that ever did match
        self.waits_for: list[Reader] = []
        self.matched: list[Reader] = []
        self.total = 0
        self.seen = (0, 0)  # the matched and the total, as somebody has looked last
        self.events = 0
        self.handle = Handle(self)

    @property
    def is_full(self) -> bool:
        return self._room is not None and self.held >= self._room

    @property
    def held(self) -> int:
        return self.samples - min((self.got[it] for it in self.waits_for), default=self.samples)

    def write(self, cdr: bytes) -> None:
        self.dds.let_fail('publish')
        if self.is_full:
            raise _rclpy.RCLError(_FULL)
        self.samples += 1
        self.dds.written.append(cdr)

    def wait_for_all_acked(self, timeout: Any) -> bool:
        assert timeout.nanoseconds == 0, 'it would wait'
        assert self.dds.tells, 'it may lie'
        self.dds.let_fail('wait')
        return self.held == 0

    def meet(self, reader: Reader) -> None:
        self.matched.append(reader)
        self.total += 1
        self.got[reader] = self.samples
        if reader.kind in RELIABLE:
            self.waits_for.append(reader)

    def acknowledge(self, reader: Reader, count: int) -> None:
        if not reader.is_dead and reader in self.got:
            self.got[reader] = min(self.samples, self.got[reader] + count)


class MatchedEvent:
    """What rclpy calls an `EventHandle`, of matches."""

    def __init__(self, handle: nullcontext[Writer], _kind: object) -> None:
        self._writer = handle.enter_result
        self._writer.dds.let_fail('event')
        self._writer.events += 1

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass

    def take_event(self) -> SimpleNamespace:
        self._writer.dds.let_fail('take')
        self._writer.dds.taken += 1
        self._writer.seen = seen = (len(self._writer.matched), self._writer.total)
        return SimpleNamespace(current_count=seen[0], total_count=seen[1])

    def destroy_when_not_in_use(self) -> None:
        self._writer.events -= 1
        self._writer.dds.let_fail('let go')


@dataclass
class Dds:
    """The middleware; it is also the handle of the node that writes.

    Args:
        room: Of the histories of writers; None where nothing bounds them.
        tells: Whether it can be believed what it tells of arrivals.
        lock: To be held while an endpoint is made or destroyed.
        graph: That of the node.
    """

    room: int | None
    tells: bool
    lock: Lock = field(default_factory=Lock)
    graph: Graph = field(init=False)
    now_s: float = 1000.0
    readers: list[Reader] = field(default_factory=list)
    come: int = 0
    written: list[bytes] = field(default_factory=list)
    writers: list[Writer] = field(default_factory=list)  # all that have ever been
    alive: list[Writer] = field(default_factory=list)
    faults: Counter[str] = field(default_factory=Counter)  # of the next calls, by their names
    failed: list[str] = field(default_factory=list)
    frozen: list[Reader] | None = None  # what the graph shows while it lags
    problem: Exception | None = None  # in the graph
    slipped: bool = False  # whether one has gone that the writer never met: no event tells
    taken: int = 0  # events
    asked: int = 0
    answer: list[Reader] | None = None  # of the graph, as it was asked last

    @property
    def writer(self) -> Writer | None:
        return self.alive[-1] if self.alive else None

    def let_fail(self, name: str) -> None:
        if self.faults[name]:
            self.faults[name] -= 1
            self.failed.append(name)
            raise _rclpy.RCLError(f'no {name}, at ./rcl.c:1')

    # What happens

    def join(self, kind: str, after_s: float) -> None:
        self.come += 1
        self.readers.append(Reader(self.come, kind, self.now_s + after_s))
        self.pass_time(0.0)

    def die(self, reader: Reader, after_s: float) -> None:
        """Let one be forgotten at once, and told of later."""
        is_met = self.writer is not None and reader in self.writer.matched
        if reader.is_dead or (reader.kind in MATCHING and not is_met):
            return
        reader.is_dead, reader.told_at_s = True, self.now_s + after_s
        for writer in self.alive:
            if reader in writer.waits_for:
                writer.waits_for.remove(reader)
        self.pass_time(0.0)

    def pass_time(self, seconds: float) -> None:
        self.now_s += seconds
        gone = [it for it in self.readers if it.is_dead and it.told_at_s <= self.now_s]
        self.readers = [it for it in self.readers if it not in gone]
        for writer in self.alive:
            writer.matched = [it for it in writer.matched if it not in gone]
        met = self.writer.got if self.writer else {}
        self.slipped |= any(it.kind in MATCHING and it not in met for it in gone)
        if (last := self.writer) is None:
            return
        for reader in self.readers:
            is_due = reader.met_at_s <= self.now_s and reader.kind in MATCHING
            if is_due and reader not in last.got and not reader.is_dead:
                last.meet(reader)

    # A node's handle

    def create_publisher(self, _class: object, _topic: str, _qos: object, **_: object) -> Writer:
        assert self.lock.locked()
        self.let_fail('create')
        for reader in self.readers:
            reader.met_at_s = max(reader.met_at_s, self.now_s + DISCOVERY_S)
        writer = Writer(self, self.room)
        self.writers.append(writer)
        self.alive.append(writer)
        return writer

    def destroy_publisher(self, writer: Writer) -> None:
        assert self.lock.locked()
        assert writer.events == 0, 'its event is let go before'
        self.alive.remove(writer)  # also where that fails: nobody uses it again
        self.let_fail('destroy')

    def get_subscriptions_info_by_topic(self, _topic: str) -> list[SimpleNamespace]:
        self.asked, self.answer = self.asked + 1, None
        if self.problem is not None:
            raise self.problem.with_traceback(None)
        self.answer = list(self.readers if self.frozen is None else self.frozen)
        return [reader.info() for reader in self.answer]
