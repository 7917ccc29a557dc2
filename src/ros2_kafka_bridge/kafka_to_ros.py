"""Kafka -> ROS: the whole way of a record to ROS, on one page.

    poll -> decode -> publish -> confirm -> commit

Everything taken and not ended is in the flight. An entry is ready until the history takes it, and
sent until its readers have it. A position moves once all before it have ended.
"""

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.endpoints import (
    HeaderList,
    MessageSink,
    Record,
    RecordSource,
    headers_of,
    source_time_ns,
)
from ros2_kafka_bridge.errors import BridgeError, RecordError, RouteError
from ros2_kafka_bridge.formats import Decode
from ros2_kafka_bridge.logs.lines import Log, summed
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.route.age import expires_s
from ros2_kafka_bridge.route.counters import Counters, Outcome
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.records import RecordEntry, RecordFlight
from ros2_kafka_bridge.route.identity import guard_loops
from ros2_kafka_bridge.route.idling import Idling
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.route.obstacle import (
    LONGEST_NAP_S,
    WINDOW_FULL,
    Blocked,
    Cause,
    Obstacle,
)
from ros2_kafka_bridge.route.pieces import in_pieces
from ros2_kafka_bridge.route.publishing import Publishing
from ros2_kafka_bridge.route.rejections import letter_of_record, rejection_of_record
from ros2_kafka_bridge.route.status import held, tell_dropped
from ros2_kafka_bridge.route.telling import Telling
from ros2_kafka_bridge.route.type_hash import CheckHeaders
from ros2_kafka_bridge.threads.drain_time import DrainTime
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.tracing.records import NO_RECORD_TRACES, RecordTraces

BATCH = 500
COMMIT_S = 0.2  # what a SIGKILL makes come twice; more often would cost requests
REVOKE_S = 5.0
_BUSY_S = 0.01
_LAST_COMMIT_S = 1.0
_NS_PER_MS = 1_000_000


class KafkaToRos:
    """Moves the records of one topic to ROS; runs in a thread of its own.

    Args:
        route: The settings of the route.
        bridge: Its name, by which a record that would go round is known.
        source: Where the records come from.
        sink: Where the messages go; open already, and stays open when the route fails.
        check_headers: Refuses a record that was written with another type.
        decode: Makes the CDR bytes of a message from a record's value. It may raise a RouteError,
            too, where it has to ask somebody who is away.
        dead_letters: Where records go that can never be delivered.
        log: Where to say what happens.
        traces: What follows the records that are sampled.
    """

    spool = None  # Kafka keeps what waits

    def __init__(
        self,
        route: KafkaToRosRoute,
        bridge: str,
        source: RecordSource,
        sink: MessageSink,
        check_headers: CheckHeaders,
        decode: Decode,
        dead_letters: DeadLetters[RecordEntry],
        log: Log,
        traces: RecordTraces = NO_RECORD_TRACES,
    ) -> None:
        self.counters = Counters(route.name)
        self.snapshot = self.counters.snapshot(0, spooled=0)
        self._meter = Meter()
        self.telling = Telling(self.counters, self._meter, dead_letters)
        self._pause = Pause()
        self._route = route
        self._source = source
        self._sink = sink
        self._skips, self._check_headers = guard_loops(bridge, route, check_headers)
        self._decode = decode
        self._dead_letters = dead_letters
        self._log = log
        self._occasional = summed(log)
        self._traces = traces
        limits = route.max_in_flight, route.max_in_flight_bytes
        self._flight = RecordFlight(*limits, drops=route.drops)
        self._publishing = Publishing(self._flight, sink.writer(route.ros_topic), route)
        self._blocked = Blocked()
        self._idling = Idling(_BUSY_S)
        self._drained_by_s = math.inf
        self._commit_at_s = 0.0
        self._max_age_s = route.max_age_s

    def run(self, stop: Stop, pause: Pause | None = None) -> None:
        """Move records until a stop is asked for, then drain.

        Raises:
            RouteError: This route cannot go on; nothing is lost by running it again.
        """
        self._pause = pause or self._pause
        self._idling.note_work()
        with self._opened():
            while not stop.asked:
                go_on = self._rest if self._pause.asked else self._step
                go_on()
            self._drain(stop)

    def _step(self) -> None:
        self._confirm()
        obstacle = self._publish_ready()
        if obstacle is None:
            self._blocked.clear()
            self._poll(self._idling.wait_s(busy=bool(self._flight)))
            obstacle = self._publish_ready()
        else:
            self._wait(obstacle)
        self._settle()
        if (failure := self._flight.failure_in_front) is not None:
            raise failure
        self._tick(obstacle)

    def _rest(self) -> None:
        """Stay in the group, and finish what was published."""
        self._blocked.clear()
        self._confirm()
        self._accept_all([*reversed(self._source.stay())])
        self._settle()
        self._tick(None)
        time.sleep(LONGEST_NAP_S)

    # 1. Kafka -> entries

    def _poll(self, timeout_s: float) -> None:
        for piece in in_pieces(self._source, BATCH, timeout_s, lambda: self._flight.fills_window):
            self._accept_all(piece)

    def _accept_all(self, last_first: list[Record]) -> None:
        flight, waiting = self._flight, []
        for entry in self._take(reversed(last_first)):
            record = last_first.pop()  # none is held for longer than it is looked at
            if flight.failure is not None:
                flight.refuse(entry, flight.failure)
            elif self._accept(entry, record):
                waiting.append(entry)
        flight.ready(waiting)

    def _take(self, records: Iterable[Record]) -> list[RecordEntry]:
        taken_s = time.monotonic()
        entries = [RecordEntry(record, taken_s) for record in records]
        self.counters.taken += len(entries)
        self._flight.take_records(entries)
        return entries

    def _accept(self, entry: RecordEntry, record: Record) -> bool:
        """Decode a record; tells whether it waits for a sink now."""
        headers = headers_of(record)
        if self._traces.follow:
            self._traces.begin(entry, record, headers)
        if headers and self._skips(headers):
            self._flight.end([entry], Outcome.SKIPPED)
            return False
        try:
            if headers:
                self._check_headers(headers)
            entry.cdr = self._decode(record.value())
            if self._max_age_s is not None:
                entry.expires_s = expires_s(record.timestamp(), self._max_age_s)
        except RecordError as error:
            return self._becomes_letter(entry, record, headers, error)
        except RouteError as error:
            self._flight.refuse(entry, error)
            return False
        if len(entry.cdr) > entry.size_bytes:
            self._flight.grow(entry, len(entry.cdr))
        made_ns = source_time_ns(headers) if headers else 0
        entry.made_ms = made_ns // _NS_PER_MS or record.timestamp()[1]
        return True

    def _becomes_letter(
        self, entry: RecordEntry, record: Record, headers: HeaderList | None, error: RecordError
    ) -> bool:
        rejection = rejection_of_record(self._route, record, headers, error)
        policy = rejection.policy(self._route.on_error)
        rejection.tell_bug(self._occasional)
        self._meter.troubles.note(error, rejection.where)
        self._traces.refused(entry, error)
        if policy == 'stop':
            self._flight.refuse(entry, rejection.failure())
            return False
        rejection.tell(policy, self._occasional)
        if policy == 'drop':
            self._flight.end([entry], Outcome.DROPPED)
            return False
        self._flight.divert(entry, letter_of_record(self._route, record, headers, error))
        return True

    # 2. entries -> ROS

    def _publish_ready(self) -> Obstacle | None:
        """Publish what waits; tells what stands in the way, None when nothing is left."""
        obstacle, published = self._publishing.publish_ready()
        if published:
            self._blocked.move()
            self._meter.publish_records(published)
        return obstacle or self._no_room()

    def _no_room(self) -> Obstacle | None:
        """Tell what keeps the bridge from reading on, None if nothing does."""
        if self._flight.failure is not None:
            return Obstacle(str(self._flight.failure))
        if self._dead_letters.problem:
            return Obstacle(self._dead_letters.problem)
        if self._flight.is_full:
            return WINDOW_FULL
        return None

    def _wait(self, obstacle: Obstacle) -> None:
        since_s = time.monotonic()
        self._blocked.note()
        drops = self._may_drop(obstacle)
        if drops and not self._flight.is_full:
            self._poll(_BUSY_S)
        elif self._blocked.is_long:
            self._accept_all([*reversed(self._source.stay())])
        dropped = len(self._flight.drop_oldest()) if drops else 0
        tell_dropped(dropped, self._occasional)
        if obstacle.cause is Cause.PACE:
            time.sleep(min(LONGEST_NAP_S, self._publishing.paced_s))
            return
        if not dropped:  # else more may be there
            self._blocked.nap()
        self._meter.waited_s += time.monotonic() - since_s

    def _may_drop(self, obstacle: Obstacle) -> bool:
        """Whether what waits may be dropped for what comes behind it."""
        return (
            self._flight.drops
            and self._publishing.lets_drop(obstacle)
            and self._flight.failure is None
            and not self._dead_letters.problem
        )

    # 3. confirmations -> positions -> commit

    def _confirm(self) -> None:
        if again := self._publishing.confirm():
            self.counters.repeated += again
            self._log.warning(
                'a subscriber of %s has gone: %d messages that it may not have received are '
                'published again',
                self._route.ros_topic, again,
            )  # fmt: skip
        self._dead_letters.step(self._flight)

    def _settle(self) -> None:
        if ended := self._flight.settled():
            self._idling.note_work()  # what is to be committed is, soon
            self._source.advance(self._flight.positions())
            self._count(ended)
        self._traces.look()

    def _count(self, ended: Sequence[RecordEntry]) -> None:
        good = Outcome.CONFIRMED
        confirmed = [entry for entry in ended if entry.stage is good]
        self.counters.end(good, len(confirmed))
        self._meter.confirm_records(confirmed)
        if len(confirmed) == len(ended):
            return
        for entry in ended:
            if (outcome := entry.outcome) is not None and outcome is not good:
                self._meter.end_record(entry)
                self.counters.end(outcome)

    def _tick(self, obstacle: Obstacle | None) -> None:
        now_s = time.monotonic()
        if now_s >= self._commit_at_s:
            self._commit_at_s = now_s + COMMIT_S
            self._source.commit()
        if self.telling.is_due(self._pause, is_calm=not self._flight and self._idling.is_calm):
            self._show(self._reason(obstacle) or self._source.away or self._source.held_back)

    def _reason(self, obstacle: Obstacle | None) -> str:
        """Why the route waits; empty where it does not, or not for long."""
        if obstacle is None or not self._blocked.is_long:
            return ''
        if obstacle.cause is Cause.HISTORY:
            who = held(self._sink.reliable_subscribers, self._blocked.still_for_s)
            return f'{obstacle.reason} ({who})'
        return obstacle.reason

    def _show(self, reason: str) -> None:
        self.telling.tell(reason, self._source, self._pause)
        self._take_snapshot(self._source.lag())

    def _take_snapshot(self, lag: int | None) -> None:
        self.counters.lost_upstream = self._source.lost_upstream
        measures = self._meter.measures(
            self._sink.load, self._sink.matches,
            bytes_held=self._flight.value_bytes, rebalances=self._source.rebalances,
        )  # fmt: skip
        size = len(self._flight)
        self.snapshot = self.counters.snapshot(size, lag, spooled=0, measures=measures)

    # Hand-over, failure, end

    def revoked(self, partitions: frozenset[int]) -> None:
        """Wait for what these partitions have in flight, and forget the rest."""
        deadline_s = min(time.monotonic() + REVOKE_S, self._drained_by_s)
        with suppress(BridgeError):  # told by the next step: a hand-over has to be ended
            while time.monotonic() < deadline_s and self._flight.has_sent(partitions):
                self._confirm()
                time.sleep(_BUSY_S)
        self.lost(partitions)

    def lost(self, partitions: frozenset[int]) -> None:
        """Forget these partitions, others may have them already."""
        with suppress(BridgeError):
            self._confirm()
        self._settle()
        self._give_back(self._flight.of(partitions))
        self._flight.forget(partitions)

    def detached(self, partitions: frozenset[int]) -> None:
        """Keep what is in flight of these: their topic is gone, nobody can read it again."""
        self._flight.detach(partitions)

    def _give_back(self, entries: list[RecordEntry]) -> None:
        """Return entries to Kafka: their offsets are not committed, they are read again."""
        if entries:
            gone = self._flight.give_back(entries)
            self.counters.end(Outcome.RETURNED, len(entries) - gone)
            if gone:
                self.counters.end(Outcome.GIVEN_UP, gone)
                self._log.error('%s of a topic that is gone: given up', count(gone, 'record'))
            self._meter.bytes_taken += sum([entry.value_bytes for entry in entries])

    def _drain(self, stop: Stop) -> None:
        drain, stays = DrainTime(stop, self._route.drain_s), True
        self._give_back(self._flight.unsent())
        while not drain.is_over() and self._flight:
            self._drained_by_s = drain.deadline_s
            self._confirm()
            stays = stays and self._stay_draining()
            self._give_back(self._flight.unsent())
            self._settle()
            time.sleep(_BUSY_S)
        left = len(self._flight)
        patience_s = 0.0 if stop.at_once else max(1.0, drain.deadline_s - time.monotonic())
        if not self._source.commit_now(patience_s):
            self._log.warning('the last offsets are not committed: some records are repeated')
        if left:
            self._log.warning(
                'gave up waiting for %d records in flight: they are read again next time', left
            )

    def _stay_draining(self) -> bool:
        """Stay in the group, if that is possible; what still comes goes back as it is."""
        try:
            self._give_back(self._take(self._source.stay()))
            self._tick(None)
        except BridgeError as error:
            self._log.warning('%s', error)
            return False
        return True

    @contextmanager
    def _opened(self) -> Iterator[None]:
        self._drained_by_s = math.inf
        self._source.open(self)
        try:
            yield
        finally:
            self._settle()
            self._give_back([*self._flight])
            self._flight.forget_all()
            self._traces.look()
            self._source.commit_now(_LAST_COMMIT_S)
            self._source.close()
            self._dead_letters.close(self._flight)
            self.counters.tell_end()
            self._take_snapshot(None)
