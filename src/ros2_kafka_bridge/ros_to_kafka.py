"""ROS -> Kafka: the whole way of a message to Kafka, on one page.

    take -> encode -> produce -> confirm

Everything taken and not ended is in the flight. An entry is ready until the producer takes it; the
delivery report ends it. While too much is in flight nothing is taken: the reader's cache fills,
and DDS holds the publisher back. A route with a spool goes on taking: see `spooling`.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.endpoints import Message, MessageSource, Outgoing, RecordSink
from ros2_kafka_bridge.errors import RecordError, RouteError
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.logs.lines import Log, summed
from ros2_kafka_bridge.route.counters import Counters, Outcome
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.messages import LINE, TAIL, MessageEntry, MessageFlight
from ros2_kafka_bridge.route.identity import Identity
from ros2_kafka_bridge.route.idling import Idling
from ros2_kafka_bridge.route.labels import Conversion
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.route.obstacle import KAFKA_IS_SLOW
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.producing import Producing
from ros2_kafka_bridge.route.rejections import Rejection, letter_of_message, rejection_of_message
from ros2_kafka_bridge.route.status import given_up, tell_dropped
from ros2_kafka_bridge.route.telling import Telling
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spool.spooling import Spooling
from ros2_kafka_bridge.threads.drain_time import DrainTime
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.tracing.messages import NO_MESSAGE_TRACES, MessageTraces

BATCH = 500
_BUSY_S = 0.005
_FULL_S = 0.02
_LAST_TAKES = 500
# A bridge that hands over takes what was published before the next one read. Where publishers are
# held back there is always more; what is taken after so long, the next one has, too.
_REST_S = 60.0


class RosToKafka:
    """Moves the messages of one ROS topic to Kafka; runs in a thread of its own.

    Args:
        route: The settings of the route.
        source: Where the messages come from; opened once, and held while the route has failed.
        in_kafka: Tells what was produced before a restart.
        sink: Where the records go.
        conversion: Makes a record of a message.
        dead_letters: Where messages go that can never be delivered.
        backlog: What waits on disk; None without a spool.
        log: Where to say what happens.
        traces: What follows the messages that are sampled.
    """

    _encode: Encode | None = None  # made when it runs for the first time

    def __init__(
        self,
        route: RosToKafkaRoute,
        source: MessageSource,
        in_kafka: Produced,
        sink: RecordSink[MessageEntry],
        conversion: Conversion,
        dead_letters: DeadLetters[MessageEntry],
        backlog: Backlog | None,
        log: Log,
        traces: MessageTraces = NO_MESSAGE_TRACES,
    ) -> None:
        self.counters = Counters(route.name)
        self.snapshot = self.counters.snapshot(0, spooled=None if backlog else 0)
        self._route = route
        self._source = source
        self._in_kafka = in_kafka
        self._sink = sink
        self._conversion = conversion
        self._dead_letters = dead_letters
        self._occasional = summed(log)
        self._traces = traces
        drops = route.drops and backlog is None
        self._flight = MessageFlight(route.max_in_flight, route.max_in_flight_bytes, drops=drops)
        self._producing = Producing(self._flight, sink, self._refuse_waiting)
        self.spool = backlog.spool if backlog else None
        self._spooling = Spooling(route, self._flight, backlog, in_kafka, self.counters, log)
        self._meter = Meter()
        self.telling = Telling(self.counters, self._meter, dead_letters)
        self._idling = Idling(_BUSY_S)
        self._pause = Pause()

    def run(self, stop: Stop, pause: Pause | None = None) -> None:
        """Move messages until a stop is asked for, then drain.

        Raises:
            RouteError: This route cannot go on; what it holds is kept for the next run.
            ConfigError: The format of the route is not possible here; nothing was taken.
        """
        self._pause = pause or self._pause
        self._prepare()
        self._idling.note_work()
        with self._opened():
            while not stop.asked:
                go_on = self._rest if self._pause.asked else self._step
                go_on()
            self._drain(stop)

    def _prepare(self) -> None:
        if self._encode is None:
            self._encode = self._conversion.make_encode()

    def deliver_backlog(self, stop: Stop) -> None:
        """Deliver what an earlier life has left on disk, and take nothing new.

        Raises:
            RouteError: That is not possible now; it stays on disk.
        """
        self._prepare()
        self._idling.note_work()
        with self._opened():
            while not stop.asked and (self._flight or self._spooling.waiting):
                self._step()
            self._drain(stop)

    def _step(self) -> None:
        """Go on by one take, if there is room for it."""
        self._spooling.step(self._sink.away, self._dead_letters.problem)
        self._drop_excess()
        room = self._room()
        if room > 0:
            if self._spooling.active or self._sink.away:
                self._idling.note_work()
            taken = self._take(room, self._idling.wait_s(busy=bool(self._flight)))
            self._producing.produce_ready()
            self._producing.send(len(taken))
            self._confirm(0.0)
        else:
            since_s = time.monotonic()
            self._confirm(_FULL_S)
            self._meter.waited_s += time.monotonic() - since_s
        self._tick()

    def _rest(self) -> None:
        """Take nothing: DDS holds the publishers back. What was taken goes on to Kafka."""
        self._spooling.step(self._sink.away, self._dead_letters.problem)
        self._producing.produce_ready()
        self._source.look()
        self._confirm(_FULL_S)
        self._tick()

    # 1. ROS -> entries

    def _room(self) -> int:
        """How many messages may be taken now."""
        if self._flight.ends:
            return 0
        if self._spooling.active:
            return self._spooling.room
        return 0 if self._dead_letters.problem else min(BATCH, self._flight.room)

    def _drop_excess(self) -> None:
        """Keep the newest of what the producer does not take, where the route asks for it."""
        self._producing.produce_ready()
        if self._flight.ends:
            return
        if self._spooling.active:
            self._spooling.drop_excess()
        elif self._flight.drops and not self._dead_letters.problem:
            dropped = self._flight.drop_oldest()
            tell_dropped(len(dropped), self._occasional)
            for entry in dropped:
                self._traces.ended(entry, Outcome.DROPPED)
        self._settle()

    def _take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        messages = self._source.take(limit, timeout_s)
        taken_s = time.monotonic()
        self._meter.bytes_taken += sum([len(message.cdr) for message in messages])
        self._accept(messages, taken_s)
        self._spooling.write()
        return messages

    def _accept(self, messages: Sequence[Message], taken_s: float) -> None:
        entries: list[MessageEntry] = []
        refused: list[tuple[MessageEntry, RecordError]] = []
        _, make_key, make_headers, check_headers = self._conversion
        topic, encode = self._route.kafka_topic, self._encode
        assert encode is not None, 'the route runs'
        try:
            for message in self._in_kafka.not_there(messages):
                headers, refusal = make_headers(message), None
                try:
                    check_headers(headers)
                    value = encode(message.cdr)
                    record = Outgoing(topic, make_key(message), value, headers)
                except RecordError as error:
                    refusal, record = error, Outgoing(topic, None, message.cdr, headers)
                entry = MessageEntry(record, message, taken_s)
                entries.append(entry)
                if refusal is not None:
                    refused.append((entry, refusal))
        finally:  # what a bug meets is lost with what is behind it; what is before it is not
            self._hold(entries, refused)
        skipped = len(messages) - len(entries)
        self.counters.taken += skipped
        self.counters.end(Outcome.SKIPPED, skipped)

    def _hold(
        self, entries: Sequence[MessageEntry], refused: Iterable[tuple[MessageEntry, RecordError]]
    ) -> None:
        behind_disk = self._spooling.active
        self.counters.taken += len(entries)
        self._flight.take(entries, TAIL if behind_disk else LINE)
        gone = set()
        for entry, error in refused:
            if not self._becomes_letter(entry, error):
                gone.add(entry)
        if not behind_disk:
            self._flight.ready([it for it in entries if it not in gone] if gone else entries)

    def _refuse_waiting(self, entry: MessageEntry, error: RecordError) -> None:
        if self._becomes_letter(entry, error):
            self._flight.ready([entry])

    def _becomes_letter(self, entry: MessageEntry, error: RecordError) -> bool:
        """Do with a message that can never be delivered what the route says."""
        rejection = rejection_of_message(self._route, entry.record.headers, error)
        rejection.tell_bug(self._occasional)
        self._meter.troubles.note(error, rejection.where)
        policy = rejection.policy(self._route.on_error)
        if policy == 'stop':
            self._flight.refuse(entry, rejection)
            return False
        identity = Identity(entry.gid, entry.seq, entry.made_ns)
        if policy == 'dead_letter' and self._in_kafka.holds_letter(identity):
            self._end(entry, Outcome.SKIPPED, error)
            return False
        rejection.tell(policy, self._occasional)
        if policy == 'drop':
            self._end(entry, Outcome.DROPPED, error)
            return False
        self._flight.divert(entry, letter_of_message(self._route, entry.record, error))
        return True

    # 2. entries -> Kafka (`Producing`), and 3. its reports -> confirmed

    def _confirm(self, timeout_s: float) -> None:
        confirmed, failed = self._producing.poll(timeout_s)
        self._flight.confirm(confirmed, Outcome.CONFIRMED)
        self._producing.produce_again(failed)
        # What looks for a topic that is away holds the thread, and the robots, for seconds.
        if not self._sink.away or self._producing.is_idle:
            self._dead_letters.step(self._flight)
        self._settle()
        failure = self._flight.failure_in_front
        if failure is not None and not self._spooling.waits_before_failure:
            self._fail(failure)

    def _fail(self, rejection: Rejection) -> None:
        """End the route for good: all before what was refused has ended."""
        self._close_sinks()
        self._spooling.leave()
        behind = len(self._flight) - (self._flight.failure_in_front is not None)
        raise rejection.failure(f', {behind} messages behind it are given up' if behind else '')

    def _end(self, entry: MessageEntry, outcome: Outcome, error: RecordError) -> None:
        self._traces.ended(entry, outcome, error)
        self._flight.end([entry], outcome)

    def _settle(self) -> None:
        """Count what has ended."""
        if not (ended := self._flight.settled()):
            return
        good = Outcome.CONFIRMED
        confirmed = [entry for entry in ended if entry.stage is good]
        self._traces.confirmed(confirmed)
        self.counters.end(good, len(confirmed))
        self._meter.confirm_messages(confirmed)
        if len(confirmed) == len(ended):
            return
        for entry in ended:
            if (outcome := entry.outcome) is not None and outcome is not good:
                self.counters.end(outcome)
                if outcome is Outcome.DEAD_LETTERED:
                    self._traces.ended(entry, outcome)

    def _tick(self) -> None:
        if not self.telling.is_due(self._pause, is_calm=not self._flight and self._idling.is_calm):
            return
        self._drop_excess()
        full = self._room() <= 0 or self._flight.pushes_out
        reason = self._sink.away or (KAFKA_IS_SLOW if full else '')
        self._show(self._spooling.full or reason)

    def _show(self, reason: str) -> None:
        self.telling.tell(reason, self._sink, self._pause, begun=self._spooling.exists)
        self._take_snapshot()

    def _take_snapshot(self) -> None:
        self.counters.lost_upstream = self._source.lost_upstream
        self.counters.unproved = self._in_kafka.unproved
        spooled, spool_bytes = self._spooling.on_disk
        measures = self._meter.measures(
            self._sink.load,
            self._source.matches,
            bytes_held=self._spooling.loaded_bytes,
            spool_bytes=spool_bytes,
            broker_round_trip_s=self._sink.round_trip_s,
        )
        held = len(self._flight)
        self.snapshot = self.counters.snapshot(held, spooled=spooled, measures=measures)

    # Failure, end

    def _drain(self, stop: Stop) -> None:
        """Take what is left, then go on until nothing is in flight."""
        drain, empty = DrainTime(stop, self._route.drain_s), False
        while not drain.is_over(limited=self._spooling.takes):
            self._spooling.make_room(self._sink.away)
            if not empty and (self._take_last() or drain.hands_over_for(_REST_S)):
                empty = True
                self._source.close()  # nobody is held back by a reader that takes no more
            if empty and self._owes_nothing():
                break
            self._producing.produce_ready()
            self._confirm(_BUSY_S if self._flight else 0.0)
            self._tick()
        empty = empty or self._take_rest()
        self._close_sinks()
        self._spooling.leave()
        if lost := given_up(len(self._flight), empty=empty):
            raise RouteError(lost, final=True)

    def _owes_nothing(self) -> bool:
        """Whether all is in Kafka, also where that lets nobody in, or on disk while it is away."""
        return not self._flight or (bool(self._sink.away) and self._spooling.keep())

    def _take_last(self) -> bool:
        """Take once more, if there is room; tells whether nothing is left to take."""
        self._spooling.write()
        self._drop_excess()
        room = self._room()
        if room <= 0:
            return False
        self._take(room, 0.0)
        return self._source.exhausted

    def _take_rest(self) -> bool:
        """Take what is left when time is up, to disk if there is one; tells whether it was all."""
        if not self._spooling.exists:
            return self._take_last()
        if not self._spooling.active:
            self._spooling.begin('stopping')
        return any(self._take_last() for _ in range(_LAST_TAKES))

    @contextmanager
    def _opened(self) -> Iterator[None]:
        try:
            self._spooling.open()
            self._flight.begin_again(behind_disk=self._spooling.active)
            self._producing.begin()
            self._sink.open()
            yield
        finally:
            self._close_sinks()
            try:
                self._spooling.close()
            finally:
                self.counters.tell_end()
                self._take_snapshot()

    def _close_sinks(self) -> None:
        self._flight.confirm(self._sink.close(), Outcome.CONFIRMED)
        self._dead_letters.close(self._flight)
        self._settle()
