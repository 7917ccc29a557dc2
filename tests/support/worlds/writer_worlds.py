"""What can happen to a publisher of a route, and what it may say of its readers then."""

import logging
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from support.ros.ends import end_of, still_node, writer_of
from support.worlds.dds import (
    KIND,
    MATCHING,
    OURS,
    READERS,
    RELIABLE,
    ROOM,
    Dds,
    MatchedEvent,
    Reader,
)
from support.worlds.dds import Writer as DdsWriter

from ros2_kafka_bridge.endpoints import Readers
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros.topic_writer import TopicWriter
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('writer'), {})
TICK_S: Final = 1 / 1024  # floats add it without a rest
AGE_S: Final = 0.05
SETTLES_S: Final = 1.0
STEP_S: Final = 60 * TICK_S
MOST_READERS: Final = 4
UNREADABLE: Final = (
    UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte'),
    OverflowError('a duration below zero'),
    _rclpy.RCLError('no graph, at ./graph.c:1'),
)


def make_writer(dds: Dds, *, asks: bool) -> TopicWriter:
    """Make what is tested, over a middleware in memory."""
    node = still_node(dds)
    dds.lock = node.endpoint_lock
    dds.graph = node.graph
    kind = MessageType(KIND, object, Layout(KIND, ()), OURS)
    bounded = dds.room is not None
    return writer_of(end_of(node, kind)._replace(log=LOG), ROOM, asks=asks, bounded=bounded)


class Event(NamedTuple):
    """Something that happens.

    Args:
        what: It is.
        how: Much, mostly.
        where: At which reader, where it is at one.
    """

    what: str
    how: int = 0
    where: int = 0


class Sent(NamedTuple):
    """A message that was published.

    Args:
        writer: By which.
        at: Its place in what that one has published.
        at_s: When.
        to: The reliable readers that were there.
        may_be_acknowledged: Whether a reader that acknowledges was in sight.
    """

    writer: DdsWriter
    at: int
    at_s: float
    to: frozenset[Reader]
    may_be_acknowledged: bool

    @property
    def has_arrived(self) -> bool:
        return all(self.writer.got[reader] > self.at for reader in self.to)


class World:
    """A publisher over a middleware, and what is known of both.

    Args:
        asks: Whether the publisher asks what has arrived.
        bounded: Whether the middleware bounds a history.
    """

    def __init__(self, *, asks: bool, bounded: bool) -> None:
        self.dds = Dds(ROOM if bounded else None, tells=asks)
        self.writer = make_writer(self.dds, asks=asks)
        self._asks, self._bounded = asks, bounded
        self._accepted: list[bytes] = []
        self._sent: list[Sent] = []  # since a reader was lost last
        self._told = Readers(0, 0, lost=False, confirmed=0, acknowledged=False)
        self._writers = 1  # as many as had been by the last look
        self._is_broken = False  # so that it has to be replaced
        self._failures = self._failed_looks = 0  # of this publisher, of all since one was well
        self._gone = 0  # by the last look
        self._seen = (0, 0)  # how many have come and gone, as events have told
        self._taken = self._asked = 0  # events, and questions to the graph, by the last look
        self._come_known = self._mismatched = 0  # as the graph could be read last
        self._misread: set[str] = set()
        self._lags = False  # whether the graph ever did
        self._age_at_s = 0.0
        self._had = [False, False, False]  # a reader that acknowledges, at looks of an age

    def opens(self) -> None:
        """Open the publisher, which asks who is there."""
        self.writer.open()
        self._asked = self.dds.asked

    # What must be true of a message

    def publish(self) -> bool:
        """Publish the next message; returns whether it was taken."""
        dds, writer, failures = self.dds, self.dds.writer, len(self.dds.failed)
        cdr = b'%d' % len(self._accepted)
        is_full = writer is None or writer.is_full
        is_at_bound = self._paces and self.writer.load.queued == ROOM
        try:
            taken = bool(self.writer.publish([cdr]))
            self.writer.raise_failure()
        except RouteError:
            assert writer is None or len(dds.failed) > failures, 'ROS has not failed'
            taken, self._is_broken = False, True
        else:
            assert taken == (not is_full and not is_at_bound)
        if taken:
            assert writer is not None
            self._accepted.append(cdr)
            self._sent.append(self._made(writer))
            assert not self._paces or self._held(writer) <= ROOM, 'more than it may'
        assert (len(dds.written), dds.written[-1:]) == (len(self._accepted), self._accepted[-1:])
        return taken

    @property
    def _paces(self) -> bool:
        """Whether the publisher itself has to see that no more than its room is under way."""
        return self._asks and not self._bounded

    def _made(self, writer: DdsWriter) -> Sent:
        to = frozenset(it for it in writer.matched if it.kind in RELIABLE)
        # One that is in the graph, and not matched yet, does not get what it is said to have
        # acknowledged.
        may = any(it.kind in RELIABLE for it in self.dds.readers)
        may = may or self._lags or self.dds.slipped
        return Sent(writer, writer.samples - 1, self.dds.now_s, to, may)

    # What must be true of a look

    def look(self) -> Readers | None:
        """Look at the readers; None where that fails."""
        failures, writers = len(self.dds.failed), len(self.dds.writers)
        try:
            told = self.writer.readers()
        except RouteError:
            failed = self.dds.failed[failures:]
            assert failed, 'ROS has not failed'
            if 'wait' in failed:
                self._ages(has=self._had[-1])
            self._look_at_publisher(failed, is_new=len(self.dds.writers) > writers)
            self._look_at_graph()
            return None
        self._look_at_publisher((), is_new=len(self.dds.writers) > writers)
        self._look_at_graph()
        self._look_at_count(told)
        if told.lost:
            assert (told.confirmed, told.acknowledged) == (0, False)
            self._sent.clear()
            self._had[-1] = bool(self.writer.reliable_subscribers)
        else:
            if self.dds.now_s >= self._age_at_s:
                self._ages(has=bool(self.writer.reliable_subscribers))
            self._look_at_confirmed(told)
        self._look_at_load()
        self._told = told
        return told

    def _ages(self, *, has: bool) -> None:
        self._age_at_s = self.dds.now_s + AGE_S
        self._had.append(has)

    def _look_at_publisher(self, failed: Collection[str], *, is_new: bool) -> None:
        """One that fails is replaced: at once as it publishes, else as it fails a second time."""
        assert is_new >= (self._is_broken and 'create' not in failed)
        # Whether the failure of an earlier publisher counts against the next is left open.
        assert is_new <= (self._is_broken or self._failed_looks >= 2)
        assert len(self.dds.alive) <= 1, 'who replaces a publisher destroys it'
        if {'create', 'event'} & {*failed}:
            self._is_broken = True
            return
        has_failed = bool(failed)
        self._failed_looks = has_failed * (self._failed_looks + 1)
        self._failures = has_failed * (self._failures * (not is_new) + 1)
        self._is_broken = self._failures >= 2

    def _look_at_graph(self) -> None:
        """It is asked as somebody comes or goes; else what it has told of itself counts."""
        dds, before = self.dds, self._seen
        took, self._taken = dds.taken > self._taken, dds.taken
        asked, self._asked = dds.asked > self._asked, dds.asked
        if took and dds.writer is not None:
            come = sum(writer.seen[1] for writer in dds.writers)
            self._seen = (come, come - dds.writer.seen[0])
        assert asked == (took and self._seen != before)
        if took:
            self._note_graph(self._seen[0])

    def _note_graph(self, come: int) -> None:
        answer = self.dds.answer
        if answer is not None:
            self._come_known = come
            self._mismatched = sum(it.kind not in MATCHING for it in answer)
            self._misread = {it.node for it in answer if it.kind == 'misreads'}
        elif come != self._come_known:
            self._misread = {'perhaps'}

    def _look_at_count(self, told: Readers) -> None:
        dds, (come, gone) = self.dds, self._seen
        assert dds.writer is not None
        assert (told.matched, told.come) == (len(dds.writer.matched), come)
        assert told.come >= self._told.come
        assert told.lost == (gone > self._gone or len(dds.writers) > self._writers)
        self._gone, self._writers = gone, len(dds.writers)
        assert self.writer.matches == (told.matched, self._mismatched)
        matching = [it for it in dds.answer or () if it.kind in MATCHING]
        has_foreign = any(it.kind == 'foreign' for it in matching)
        assert told.foreign == (has_foreign or told.matched > len(matching))
        assert bool(told.misread) == bool(self._misread)
        assert all(name in told.misread for name in self._misread)
        waited_for = {it.holder for it in dds.answer or () if it.kind in RELIABLE}
        assert list(self.writer.reliable_subscribers) == sorted(waited_for)

    def _look_at_confirmed(self, told: Readers) -> None:
        before = 0 if self._told.lost else self._told.confirmed
        assert before <= told.confirmed <= len(self._sent)
        for sent in self._sent[before : told.confirmed]:
            assert sent.at_s + AGE_S <= self.dds.now_s, 'it may have had no time to tell of a loss'
            assert not self._asks or sent.has_arrived, 'one has not got it'
        if told.acknowledged:
            # One was in the graph at the look that has counted, and at the one before.
            assert self._asks
            assert self._had[-3]
            assert self._had[-2]
            # What nobody was there to get is counted along where what came later is waited for.
            counted = self._sent[told.confirmed - 1 :] if told.confirmed > before else ()
            assert not counted or any(it.may_be_acknowledged for it in counted), 'by nobody'

    def _look_at_load(self) -> None:
        queued, limit = self.writer.load
        assert limit == (ROOM if self._asks or self._bounded else None)
        assert 0 <= queued <= (len(self._sent) if limit is None else limit)
        writer = self.dds.writer
        if self._asks and writer is not None:
            assert queued >= min(self._held(writer), ROOM), 'less than its history holds'

    def _held(self, writer: DdsWriter) -> int:
        """How many its history holds of those published since the last loss."""
        return min(writer.held, sum(it.writer is writer for it in self._sent))

    # What happens

    def happens(self, event: Event) -> None:
        what, how, where = event
        dds, readers = self.dds, self.dds.readers
        if what in READERS:
            if len(readers) < MOST_READERS:
                dds.join(what, max(0, how - 6) * TICK_S)
        elif what in {'acknowledges', 'dies', 'is replaced'}:
            if readers:
                self._befalls(readers[where % len(readers)], what, how)
        elif what.startswith('no '):
            dds.faults[what[3:]] = 1 + how % 2
        else:
            self._does(what, how)

    def _befalls(self, reader: Reader, what: str, how: int) -> None:
        """What happens to a reader."""
        dds = self.dds
        if what == 'acknowledges':
            if dds.writer is not None:
                dds.writer.acknowledge(reader, how)
        elif what == 'dies':
            dds.die(reader, how * 4 * TICK_S)
        else:
            dds.die(reader, 0.0)
            dds.join(reader.kind, 0.0)

    def _does(self, what: str, how: int) -> None:
        match what:
            case 'publish':
                for _ in range(how):
                    self.publish()
            case 'look':
                self.look()
            case 'looks':
                for _ in range(how):
                    self.look()
                    self.dds.pass_time(20 * TICK_S)
            case 'ticks':
                self.dds.pass_time(how * 5 * TICK_S)
            case 'time':
                self.dds.pass_time(how * 0.25)
            case 'flows':
                for _ in range(how):
                    self._flows()
            case _:
                self._befalls_graph(what, how)

    def _flows(self) -> None:
        self.publish()
        self._acknowledge(1)
        self.dds.pass_time(20 * TICK_S)
        self.look()

    def _acknowledge(self, count: int) -> None:
        if (writer := self.dds.writer) is not None:
            for reader in self.dds.readers:
                writer.acknowledge(reader, count)

    def _befalls_graph(self, what: str, how: int) -> None:
        match what:
            case 'graph tells':
                self._graph_tells()
            case 'graph stands':
                self._lags, self.dds.frozen = True, list(self.dds.readers)
            case 'graph is unreadable':
                self.dds.problem = UNREADABLE[how % len(UNREADABLE)]
            case _:
                assert what == 'graph is well'
                self.dds.frozen = self.dds.problem = None

    def _graph_tells(self) -> None:
        """Some time after it has changed, which may be long."""
        self.dds.graph.look()
        self._asked = self.dds.asked

    # The end

    def ends(self) -> None:
        """All is well again: what is published arrives, and that is told."""
        dds = self.dds
        dds.faults.clear()
        dds.frozen = dds.problem = None
        dds.join('reliable', 0.0)
        dds.pass_time(SETTLES_S)
        self._graph_tells()
        for _ in range(4):  # it replaces what failed, and hears of all
            self._passes()
        if self._bounded:
            self._streams()
        self._acknowledge(len(self._accepted))
        told = [self._passes() for _ in range(3)][-1]
        matched = len(dds.readers) - self._mismatched
        assert told[:5] == (matched, self._seen[0], False, len(self._sent), self._asks)
        assert self.writer.load.queued == 0
        assert self.publish()
        assert dds.written == self._accepted
        self.writer.close()
        assert not dds.alive
        assert not any(writer.events for writer in dds.writers)

    def _passes(self) -> Readers:
        self.dds.pass_time(STEP_S)
        told = self.look()
        return self._told if told is None else told

    def _streams(self) -> None:
        """Keep the history full: all but what it holds is confirmed, an age after it could be."""
        published = []
        for _ in range(2 * ROOM):
            taken = [self.publish() for _ in range(ROOM + 1)]
            assert not taken[-1], 'it is never full'
            published.append(len(self._sent))
            told = self._passes()
            if len(published) > 2:
                assert told.confirmed >= published[-2] - ROOM
            self._acknowledge(1)


@contextmanager
def a_world(*, asks: bool, bounded: bool) -> Iterator[World]:
    """A world whose time passes only where it is told to."""
    with pytest.MonkeyPatch.context() as patch:
        world = World(asks=asks, bounded=bounded)
        patch.setattr(LOG.logger, 'disabled', True)
        patch.setattr(_rclpy, 'EventHandle', MatchedEvent)
        patch.setattr('time.monotonic', lambda: world.dds.now_s)
        world.opens()
        yield world
