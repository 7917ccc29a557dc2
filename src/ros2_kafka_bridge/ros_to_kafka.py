"""ROS -> Kafka: the whole way of a message to Kafka, on one page.

    take -> encode -> produce -> confirm

Everything taken and not ended is in the window. An entry waits in its `pending` until the
producer takes it; the delivery report ends it. While the window is full nothing is taken: the
reader's cache fills, and DDS holds the publisher back. A route with a spool goes on taking: see
`spooling`.
"""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.dead_letters import DeadLetters, explain, from_ros, without_value
from ros2_kafka_bridge.endpoints import HeaderList, Message, MessageSource, Outgoing, RecordSink
from ros2_kafka_bridge.errors import (
    BridgeError,
    RecordError,
    RecordTooLargeError,
    RouteError,
    TransportError,
)
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.logs import Occasional
from ros2_kafka_bridge.metrics import Counters, Outcome
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spooling import InKafka, Spooling
from ros2_kafka_bridge.stop import Stop
from ros2_kafka_bridge.window import Entry, Window

BATCH = 500
SNAPSHOT_S = 1.0
_IDLE_S = 0.1
_BUSY_S = 0.005
_FULL_S = 0.02
# A wake-up costs as much as ten messages, a request as much as a hundred. Where messages come
# often, a short rest lets the next ones gather; where they come seldom, none waits for another.
_OFTEN_PER_S = 2000.0
_SMALL_BATCH = 50
_GATHER_S = 0.001
_LAST_TAKES = 100

MakeKey = Callable[[Message], bytes | None]
"""Message -> key of its record."""

MakeHeaders = Callable[[Message], HeaderList]
"""Message -> headers of its record."""


class RosToKafka:
    """Moves the messages of one ROS topic to Kafka; runs in a thread of its own.

    Args:
        route: The settings of the route.
        source: Where the messages come from; opened once, and held while the route has failed.
        in_kafka: Tells what was produced before a restart.
        sink: Where the records go.
        encode: Makes a record's value from the CDR bytes of a message.
        make_key: Makes a record's key from a message that `encode` accepted.
        make_headers: Makes a record's headers.
        dead_letters: Where messages go that can never be delivered.
        backlog: What waits on disk.
        log: Where to say what happens.
    """

    def __init__(
        self,
        route: RosToKafkaRoute,
        source: MessageSource,
        in_kafka: InKafka,
        sink: RecordSink[Entry],
        encode: Encode,
        make_key: MakeKey,
        make_headers: MakeHeaders,
        dead_letters: DeadLetters[Entry],
        backlog: Backlog,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self.counters = Counters(route.name)
        self.snapshot = self.counters.snapshot(0)
        self._route = route
        self._source = source
        self._in_kafka = in_kafka
        self._sink = sink
        self._encode = encode
        self._make_key = make_key
        self._make_headers = make_headers
        self._dead_letters = dead_letters
        self._occasional = Occasional(log)
        self._window = Window(route.max_in_flight, route.max_in_flight_bytes)
        self._spooling = Spooling(
            route, self._window, self._put_in_line, backlog, in_kafka, self.counters, log
        )
        self._producing = 0  # how many the producer has got
        self._alone: Entry | None = None
        self._failed: str | None = None  # why the route ends, where on_error is stop
        self._number = 0
        self._taken_at_s = 0.0
        self._tick_at_s = 0.0

    def run(self, stop: Stop) -> None:
        """Move messages until a stop is asked for, then drain.

        Raises:
            RouteError: This route cannot go on; what it holds is kept for the next run.
        """
        with self._opened():
            while not stop.asked:
                self._step()
            self._drain(stop)

    def deliver_backlog(self, stop: Stop) -> None:
        """Deliver what an earlier life has left on disk, and take nothing new.

        Raises:
            RouteError: That is not possible now; it stays on disk.
        """
        with self._opened():
            while not stop.asked and (self._window or self._spooling.waiting):
                self._step()
            self._drain(stop)

    def _step(self) -> None:
        self._spooling.step(self._sink.away or self._dead_letters.problem)
        self._produce_pending()
        room = self._room()
        if room > 0:
            taken = self._take(room, _BUSY_S if self._window else _IDLE_S)
            self._produce_pending()
            self._send(taken)
        self._confirm(0.0 if room > 0 else _FULL_S)
        self._tick()

    def _send(self, taken: int) -> None:
        """Send what was taken, at once where messages come seldom."""
        now_s = time.monotonic()
        if 0 < taken < _SMALL_BATCH:
            if taken > _OFTEN_PER_S * (now_s - self._taken_at_s):
                time.sleep(_GATHER_S)
            else:
                self._sink.hurry()
        self._taken_at_s = now_s

    # 1. ROS -> entries

    def _room(self) -> int:
        if self._failed is not None:
            return 0
        if self._spooling.active:
            return self._spooling.room()
        if self._dead_letters.problem:
            return 0
        if self._route.when_full == 'drop_oldest' and not self._spooling.exists:
            self._drop_oldest()
            return 0 if self._window.size_bytes > self._window.max_bytes else BATCH
        return min(BATCH, self._window.room)

    def _take(self, limit: int, timeout_s: float) -> int:
        messages = self._source.take(limit, timeout_s)
        for message in messages:
            self._accept(message)
        self._spooling.write()
        return len(messages)

    def _accept(self, message: Message) -> None:
        self.counters.taken += 1
        if self._in_kafka.contains(message):
            self.counters.end(Outcome.SKIPPED)
            return
        headers = self._make_headers(message)
        topic = self._route.sink.kafka
        try:
            value = self._encode(message.cdr)
            record = Outgoing(topic, self._make_key(message), value, headers)
        except RecordError as error:
            entry = self._hold(Outgoing(topic, None, message.cdr, headers), message)
            if self._is_dead(entry, error):
                self._queue(entry)
        else:
            self._queue(self._hold(record, message))

    def _hold(self, record: Outgoing, message: Message) -> Entry:
        self._number += 1
        entry = Entry(self._number, record, message.gid, message.seq)
        self._window.put(entry)
        return entry

    def _queue(self, entry: Entry) -> None:
        if self._spooling.active:
            self._spooling.add(entry)
        else:
            self._put_in_line(entry)

    def _put_in_line(self, entry: Entry) -> None:
        if entry.number >= self._window.stop_at:
            return
        entry.in_line = True
        if entry.dead:
            self._dead_letters.add(entry.record, entry)
        else:
            self._window.pending.append(entry)

    def _is_dead(self, entry: Entry, error: RecordError) -> bool:
        """Do what `on_error` says; tells whether the entry has become a dead letter."""
        where = f'{self._route.source.ros} -> {self._route.sink.kafka}'
        if self._route.on_error == 'stop':
            entry.in_line, entry.refused = False, True
            if entry.number < self._window.stop_at:
                self._window.stop_at = entry.number
                self._failed = f'{where}: {error}'
            return False
        self._occasional.warning(f'{self._route.on_error}: {where}: {error}')
        if self._route.on_error == 'drop':
            self._end(entry, Outcome.DROPPED)
            return False
        origin = from_ros(self._route.name, self._route.source.ros, self._route.sink.kafka)
        letter = explain(entry.record, error, origin)
        entry.dead = True
        entry.record = without_value(letter) if isinstance(error, RecordTooLargeError) else letter
        return True

    def _drop_oldest(self) -> None:
        window, pending = self._window, self._window.pending
        while pending and (
            len(pending) > window.max_entries or window.size_bytes > window.max_bytes
        ):
            self._end(pending.popleft(), Outcome.DROPPED)

    # 2. entries -> Kafka

    def _produce_pending(self) -> None:
        pending, produce = self._window.pending, self._sink.produce
        if self._alone is not None:
            return
        while pending:
            entry = pending[0]
            if entry.alone and self._producing:
                return
            try:
                if not produce(entry.record, entry):
                    return
                pending.popleft()
                self._producing += 1
            except RecordTooLargeError as error:
                pending.popleft()
                self._refuse(entry, error)
                continue
            if entry.alone:
                self._alone = entry
                return

    def _refuse(self, entry: Entry, error: RecordError) -> None:
        if self._is_dead(entry, error):
            self._put_in_line(entry)

    # 3. delivery reports -> confirmed

    def _confirm(self, timeout_s: float) -> None:
        confirmed, failed = self._sink.poll(timeout_s)
        self._window.remove_all(confirmed)
        self.counters.end(Outcome.CONFIRMED, len(confirmed))
        self._producing -= len(confirmed) + len(failed)
        if not self._producing:
            self._alone = None
        if failed:
            self._retry(failed)
        # What looks for a topic that is away holds the thread, and the robots, for seconds.
        if not self._sink.away or not self._producing:
            for entry in self._dead_letters.poll():
                self._end(entry, Outcome.DEAD_LETTERED)
        if self._failed is not None and not self._spooling.holds_before(self._window.stop_at):
            self._fail(self._failed)

    def _fail(self, reason: str) -> None:
        """End the route for good: all before what was refused has ended."""
        self._close_sinks()
        self._spooling.put_away()
        behind = len(self._window.entries.keys() - {self._window.stop_at})
        given_up = f', {behind} messages behind it are given up' if behind else ''
        raise RouteError(f'{reason}; stopped, as on_error says{given_up}', final=True)

    def _end(self, entry: Entry, outcome: Outcome) -> None:
        self._window.remove(entry)
        self.counters.end(outcome)

    def _retry(self, failed: Sequence[tuple[Entry, BridgeError]]) -> None:
        again = []
        for entry, error in failed:
            if isinstance(error, RecordTooLargeError) and not entry.alone:
                # A broker that refuses a batch for its size refuses all the records in it.
                entry.alone = True
                again.append(entry)
            elif isinstance(error, RecordError):
                self._refuse(entry, error)
            elif isinstance(error, TransportError):
                again.append(entry)
            else:
                raise error
        again.sort(key=lambda entry: entry.number)
        self._window.pending.extendleft(reversed(again))

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s < self._tick_at_s:
            return
        self._tick_at_s = now_s + SNAPSHOT_S
        full = self._room() <= 0 or len(self._window.pending) >= self._window.max_entries
        away = self._sink.away if self._window else ''
        reason = away or ('the window is full: Kafka takes too slowly' if full else '')
        self._show(self._spooling.full or reason)

    def _show(self, reason: str) -> None:
        self.counters.tell(self._dead_letters.problem, reason)
        self._take_snapshot()

    def _take_snapshot(self) -> None:
        self.counters.lost_upstream = self._source.lost_upstream
        self.snapshot = self.counters.snapshot(len(self._window), spooled=self._spooling.waiting)

    # Failure, end

    def _drain(self, stop: Stop) -> None:
        deadline_s = time.monotonic() + self._route.drain_s
        empty = False
        while time.monotonic() < deadline_s and not stop.at_once:
            self._spooling.begin_if_stuck(self._sink.away)
            empty = empty or self._take_last()
            self._produce_pending()
            self._confirm(_BUSY_S if self._window else 0.0)
            if empty and (not self._window or (self._sink.away and self._spooling.keep())):
                break
        empty = empty or self._take_rest()
        self._close_sinks()
        self._spooling.put_away()
        held = len(self._window)
        given_up = [f'{held} messages that Kafka has not confirmed'] * bool(held)
        given_up += ['what was not taken yet'] * (not empty)
        if given_up:
            raise RouteError(
                f'gave up {" and ".join(given_up)}: lost unless the publisher is TRANSIENT_LOCAL',
                final=True,
            )

    def _take_last(self) -> bool:
        """Take once more, if there is room; tells whether nothing is left to take."""
        self._spooling.write()
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
            self._number = max(self._number, self._spooling.open())
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
        for entry in (*self._sink.close(), *self._dead_letters.close()):
            self._end(entry, Outcome.DEAD_LETTERED if entry.dead else Outcome.CONFIRMED)

    def _resume(self) -> None:
        """Put what a failed run left back in line, in the order of taking."""
        self._alone = None
        self._producing = 0
        self._window.pending.clear()
        for entry in self._window.ascending():
            self._spooling.resume(entry)
