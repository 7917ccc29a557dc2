"""ROS -> Kafka: the whole way of a message to Kafka, on one page.

    take -> encode -> produce -> confirm

Everything taken and not ended is in the window. An entry waits in its `pending` until the
producer takes it; the delivery report ends it. While the window is full nothing is taken: the
reader's cache fills, and DDS holds the publisher back. A route with a spool goes on taking: see
`spooling`.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.writer import DeadLetters
from ros2_kafka_bridge.endpoints import Message, MessageSource, Outgoing, RecordSink
from ros2_kafka_bridge.errors import RecordError, RouteError
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.route.counters import Counters, Outcome
from ros2_kafka_bridge.route.gathering import Gathering
from ros2_kafka_bridge.route.identity import Identity
from ros2_kafka_bridge.route.labels import MakeHeaders, MakeKey
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.route.message_window import MessageEntry, MessageWindow
from ros2_kafka_bridge.route.place import ASIDE, PENDING, SENT
from ros2_kafka_bridge.route.producing import Producing
from ros2_kafka_bridge.route.rejections import Rejection, letter_of_message, rejection_of_message
from ros2_kafka_bridge.route.status import given_up
from ros2_kafka_bridge.route.telling import Telling
from ros2_kafka_bridge.route.type_hash import CheckHeaders
from ros2_kafka_bridge.spool.already_sent import InKafka
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spool.spooling import Spooling
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.tracing.messages import NO_MESSAGE_TRACES, MessageTraces

BATCH = 500
_IDLE_S = 0.1
_BUSY_S = 0.005
_FULL_S = 0.02
_LAST_TAKES = 100
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
        make_encode: Makes, when the route runs for the first time, what makes a record's value
            from the CDR bytes of a message. It may raise a RouteError and be asked again: the
            source holds the publishers back meanwhile.
        make_key: Makes a record's key from a message that was encoded.
        make_headers: Makes a record's headers.
        check_headers: Refuses a message of another version of its type.
        dead_letters: Where messages go that can never be delivered.
        backlog: What waits on disk.
        log: Where to say what happens.
        traces: What follows the messages that are sampled.
    """

    def __init__(
        self,
        route: RosToKafkaRoute,
        source: MessageSource,
        in_kafka: InKafka,
        sink: RecordSink[MessageEntry],
        make_encode: Callable[[], Encode],
        make_key: MakeKey,
        make_headers: MakeHeaders,
        check_headers: CheckHeaders,
        dead_letters: DeadLetters[MessageEntry],
        backlog: Backlog,
        log: logging.LoggerAdapter[logging.Logger],
        traces: MessageTraces = NO_MESSAGE_TRACES,
    ) -> None:
        self.counters = Counters(route.name)
        self.snapshot = self.counters.snapshot(0, spooled=backlog.on_disk.messages)
        self._route = route
        self._topic = route.kafka_topic
        self._source = source
        self._in_kafka = in_kafka
        self._sink = sink
        self._make_encode = make_encode
        self._encode: Encode | None = None
        self._make_key = make_key
        self._make_headers = make_headers
        self._check_headers = check_headers
        self._dead_letters = dead_letters
        self._occasional = summed(log)
        self._traces = traces
        drops = route.when_full == 'drop_oldest' and not backlog.exists
        self._window = MessageWindow(route.max_in_flight, route.max_in_flight_bytes, drops=drops)
        refuse = partial(self._refuse, queue=self._put_in_line)
        self._producing = Producing(self._window, sink, refuse)
        self._spooling = Spooling(
            route, self._window, self._put_in_line, backlog, in_kafka, self.counters, log
        )
        self._meter = Meter()
        self._telling = Telling(self.counters, self._meter, dead_letters)
        self._gathering = Gathering(sink.hurry)
        self._pause = Pause()

    def claim_spool(self) -> None:
        """Keep the spool for this process until `let_go_spool`, also between two runs.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        self._spooling.claim()

    def let_go_spool(self) -> None:
        """Leave the spool to any process."""
        self._spooling.let_go()

    def run(self, stop: Stop, pause: Pause | None = None) -> None:
        """Move messages until a stop is asked for, then drain.

        Raises:
            RouteError: This route cannot go on; what it holds is kept for the next run.
            ConfigError: The format of the route is not possible here; nothing was taken.
        """
        self._pause = pause or self._pause
        self._prepare()
        with self._opened():
            while not stop.look():
                taken = self._rest() if self._pause.asked else self._step()
                if stop.overlaps:
                    newest = {m.gid: m.source_time_ns for m in taken or ()}
                    stop.note_taken(None if taken is None else newest)
            self._drain(stop)

    def _prepare(self) -> None:
        if self._encode is None:
            self._encode = self._make_encode()

    def deliver_backlog(self, stop: Stop) -> None:
        """Deliver what an earlier life has left on disk, and take nothing new.

        Raises:
            RouteError: That is not possible now; it stays on disk.
        """
        with self._opened():
            while not stop.look() and (self._window or self._spooling.waiting):
                self._step()
            self._drain(stop)

    def _step(self) -> Sequence[Message] | None:
        """Go on by one take; returns what it has brought, None where there was no room for it."""
        taken = None
        self._spooling.step(self._sink.away, self._dead_letters.problem)
        self._producing.produce_pending()
        self._drop_excess()
        room = self._room()
        if room > 0:
            taken = self._take(room, _BUSY_S if self._window else _IDLE_S)
            self._producing.produce_pending()
            self._gathering.send(len(taken))
            self._confirm(0.0)
        else:
            since_s = time.monotonic()
            self._confirm(_FULL_S)
            self._meter.waited_s += time.monotonic() - since_s
        self._tick()
        return taken

    def _rest(self) -> Sequence[Message]:
        """Take nothing: DDS holds the publishers back. What was taken goes on to Kafka."""
        self._spooling.step(self._sink.away, self._dead_letters.problem)
        self._producing.produce_pending()
        self._source.look()
        self._confirm(_FULL_S)
        self._tick()
        return ()

    # 1. ROS -> entries

    def _room(self) -> int:
        """How many messages may be taken now."""
        if self._window.failure is not None:
            return 0
        if self._spooling.active:
            return self._spooling.room
        return 0 if self._dead_letters.problem else min(BATCH, self._window.room)

    def _drop_excess(self) -> None:
        """Keep the newest, where the route asks for it."""
        if self._window.failure is not None:
            return
        if self._spooling.active:
            self._spooling.drop_excess()
        elif not self._dead_letters.problem:
            for entry in self._window.drop_oldest():
                self._traces.ended(entry, Outcome.DROPPED)
                self.counters.end(Outcome.DROPPED)

    def _take(self, limit: int, timeout_s: float) -> Sequence[Message]:
        messages = self._source.take(limit, timeout_s)
        taken_s = time.monotonic()
        self._meter.bytes_taken += sum([len(message.cdr) for message in messages])
        queue = self._spooling.add if self._spooling.active else self._put_in_line
        for message in messages:
            self._accept(message, taken_s, queue)
        self._spooling.write()
        return messages

    def _accept(
        self, message: Message, taken_s: float, queue: Callable[[MessageEntry], None]
    ) -> None:
        self.counters.taken += 1
        if self._in_kafka.contains(message):
            self.counters.end(Outcome.SKIPPED)
            return
        headers = self._make_headers(message)
        assert self._encode is not None, 'the route runs'
        try:
            self._check_headers(headers)
            value = self._encode(message.cdr)
            record = Outgoing(self._topic, self._make_key(message), value, headers)
        except RecordError as error:
            record = Outgoing(self._topic, None, message.cdr, headers)
            self._refuse(self._window.add(record, message, taken_s), error, queue)
        else:
            queue(self._window.add(record, message, taken_s))

    def _put_in_line(self, entry: MessageEntry) -> None:
        if not self._window.may_go_on(entry):
            entry.place = ASIDE
            return
        if entry.is_letter:
            entry.place = SENT
            self._dead_letters.add(entry.record, entry)
        else:
            entry.place = PENDING
            self._window.pending.append(entry)

    def _refuse(
        self, entry: MessageEntry, error: RecordError, queue: Callable[[MessageEntry], None]
    ) -> None:
        rejection = rejection_of_message(self._route, entry.record.headers, error)
        rejection.tell_bug(self._occasional)
        self._meter.troubles.note(error, rejection.where)
        policy = rejection.policy(self._route.on_error)
        if policy == 'stop':
            self._window.end_at(entry, rejection)
            return
        identity = Identity(entry.gid, entry.seq, entry.made_ns)
        if policy == 'dead_letter' and self._in_kafka.holds_letter(identity):
            self._end(entry, Outcome.SKIPPED, error)
            return
        rejection.tell(policy, self._occasional)
        if policy == 'drop':
            self._end(entry, Outcome.DROPPED, error)
            return
        entry.is_letter = True
        entry.record = letter_of_message(self._route, entry.record, error)
        queue(entry)

    # 2. entries -> Kafka (`Producing`), and 3. its reports -> confirmed

    def _confirm(self, timeout_s: float) -> None:
        confirmed, failed = self._producing.poll(timeout_s)
        self._window.remove_all(confirmed)
        self._traces.confirmed(confirmed)
        self.counters.end(Outcome.CONFIRMED, len(confirmed))
        self._meter.confirm_messages(confirmed)
        self._producing.produce_again(failed)
        # What looks for a topic that is away holds the thread, and the robots, for seconds.
        if not self._sink.away or self._producing.is_idle:
            for entry in self._dead_letters.poll():
                self._end(entry, Outcome.DEAD_LETTERED)
        failure = self._window.failure
        if failure is not None and not self._spooling.holds_before(self._window.ends_at):
            self._fail(failure)

    def _fail(self, rejection: Rejection) -> None:
        """End the route for good: all before what was refused has ended."""
        self._close_sinks()
        self._spooling.leave()
        behind = len(self._window.entries.keys() - {self._window.ends_at})
        raise rejection.failure(f', {behind} messages behind it are given up' if behind else '')

    def _end(
        self, entry: MessageEntry, outcome: Outcome, error: RecordError | None = None
    ) -> None:
        self._traces.ended(entry, outcome, error)
        self._window.remove(entry)
        self.counters.end(outcome)

    def _tick(self) -> None:
        if not self._telling.is_due(self._pause):
            return
        self._drop_excess()
        full = self._room() <= 0 or len(self._window.pending) >= self._window.max_entries
        reason = self._sink.away or ('the window is full: Kafka takes too slowly' if full else '')
        self._show(self._spooling.full or reason)

    def _show(self, reason: str) -> None:
        self._telling.tell(reason, self._sink, self._pause, begun=self._spooling.exists)
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
        held = len(self._window)
        self.snapshot = self.counters.snapshot(held, spooled=spooled, measures=measures)

    # Failure, end

    def _drain(self, stop: Stop) -> None:
        began_s, deadline_s, empty = time.monotonic(), math.inf, False
        while time.monotonic() < deadline_s and not stop.at_once:
            stop.look()
            if deadline_s == math.inf and (stop.is_end or self._spooling.takes):
                deadline_s = time.monotonic() + self._route.drain_s
            if not self._spooling.takes:
                self._spooling.step(self._sink.away)  # one that is full is emptied first
            self._spooling.begin_if_stuck(self._sink.away)
            empty = empty or self._take_last()
            if not stop.is_end and (empty or time.monotonic() - began_s > _REST_S):
                empty = True
                self._source.close()  # the next bridge is not held back by a reader that is idle
            if empty and not self._window:
                break  # nothing is owed to Kafka, also where it lets nobody in
            self._producing.produce_pending()
            self._confirm(_BUSY_S if self._window else 0.0)
            if empty and self._sink.away and self._spooling.keep():
                break
            self._tick()
        empty = empty or self._take_rest()
        self._close_sinks()
        self._spooling.leave()
        if lost := given_up(len(self._window), empty=empty):
            raise RouteError(lost, final=True)

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
            self._window.count_from(self._spooling.open())
            self._resume()
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
        delivered = [*self._sink.close(), *self._dead_letters.close()]
        for entry in delivered:
            self._end(entry, Outcome.DEAD_LETTERED if entry.is_letter else Outcome.CONFIRMED)
        self._meter.confirm_messages([entry for entry in delivered if not entry.is_letter])

    def _resume(self) -> None:
        """Put what a failed run left back in line, in the order of taking."""
        self._producing.begin()
        self._window.pending.clear()
        for entry in self._window.ascending():
            self._spooling.resume(entry)
