"""Kafka -> ROS: the whole way of a record to ROS, on one page.

    poll -> decode -> publish -> confirm -> commit

Everything taken and not ended is in `window`, in the order of consumption. An entry waits in
`pending` until the history takes it, then in `unconfirmed` until its readers have it. An entry
that has ended leaves the window once all before it have: only then does its offset count.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ros2_kafka_bridge.config.settings import KafkaToRosRoute
from ros2_kafka_bridge.dead_letters import DeadLetters, explain, from_kafka
from ros2_kafka_bridge.endpoints import (
    HeaderList,
    MessageSink,
    Outgoing,
    Readers,
    Record,
    RecordSource,
)
from ros2_kafka_bridge.errors import RecordError, RouteError
from ros2_kafka_bridge.formats import Decode
from ros2_kafka_bridge.kafka.headers import headers_of
from ros2_kafka_bridge.logs import Occasional
from ros2_kafka_bridge.metrics import Counters, Outcome
from ros2_kafka_bridge.pace import Pace, expires
from ros2_kafka_bridge.stop import Stop

BATCH = 500
COMMIT_S = 0.2  # what a SIGKILL makes come twice; more often would cost requests
SNAPSHOT_S = 1.0
SETTLE_S = 0.5
REVOKE_S = 5.0
HOLD_AFTER_S = 1.0
_IDLE_S = 0.1
_BUSY_S = 0.01
_LAST_COMMIT_S = 1.0
_SHORTEST_NAP_S = 0.0005
_LONGEST_NAP_S = 0.02
_ENTRY_BYTES = 400  # of bookkeeping for each entry, so that small records count too


class Entry:
    """One record on its way; it holds nothing of the record that is not counted as its size."""

    timestamp: tuple[int, int]  # only where records age

    __slots__ = ('cdr', 'failure', 'offset', 'outcome', 'partition', 'size_bytes', 'timestamp')

    def __init__(self, record: Record) -> None:
        self.partition = record.partition() or 0
        self.offset = record.offset() or 0
        self.size_bytes = len(record.value() or b'') + _ENTRY_BYTES
        self.cdr = b''
        self.outcome: Outcome | None = None
        self.failure: RouteError | None = None  # ends the route once all before it have ended


class KafkaToRos:
    """Moves the records of one topic to ROS; runs in a thread of its own.

    Args:
        route: The settings of the route.
        origin: Name of the bridge; its own records are skipped.
        source: Where the records come from.
        sink: Where the messages go; open already, and stays open when the route fails.
        decode: Makes the CDR bytes of a message from a record's value.
        dead_letters: Where records go that can never be delivered.
        log: Where to say what happens.
    """

    def __init__(
        self,
        route: KafkaToRosRoute,
        origin: str,
        source: RecordSource,
        sink: MessageSink,
        decode: Decode,
        dead_letters: DeadLetters[Entry],
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self.counters = Counters(route.name)
        self.snapshot = self.counters.snapshot(0)
        self._route = route
        self._origin = origin.encode()
        self._source = source
        self._sink = sink
        self._decode = decode
        self._dead_letters = dead_letters
        self._log = log
        self._occasional = Occasional(log)
        self._window: deque[Entry] = deque()
        self._window_bytes = 0
        self._pending: deque[Entry] = deque()
        self._unconfirmed: deque[Entry] = deque()
        self._confirmed = 0  # of those published since a reader was lost last
        self._positions: dict[int, int] = {}
        self._ready_at_s: float | None = None
        self._blocked_since_s: float | None = None
        self._nap_s = _SHORTEST_NAP_S
        self._commit_at_s = 0.0
        self._tick_at_s = 0.0
        self._pace = Pace(route.max_rate)
        self._ages = route.max_age_s is not None
        self._expired = expires(route.max_age_s)

    def run(self, stop: Stop) -> None:
        """Move records until a stop is asked for, then drain.

        Raises:
            RouteError: This route cannot go on; nothing is lost by running it again.
        """
        with self._opened():
            while not stop.asked:
                self._step()
            self._drain(stop)

    def _step(self) -> None:
        readers = self._confirm()
        obstacle = self._publish_pending(readers)
        if obstacle is None:
            self._blocked_since_s = None
            self._nap_s = _SHORTEST_NAP_S
            self._poll(_BUSY_S if self._window else _IDLE_S)
            obstacle = self._publish_pending(readers)
        else:
            self._wait(obstacle)
        self._settle()
        if self._window and (failure := self._window[0].failure) is not None:
            raise failure
        self._tick(obstacle)

    # 1. Kafka -> entries

    def _poll(self, timeout_s: float) -> None:
        for record in self._source.poll(BATCH, timeout_s):
            self._accept(record)

    def _accept(self, record: Record) -> None:
        entry = Entry(record)
        self.counters.taken += 1
        self._positions.setdefault(entry.partition, entry.offset)
        self._window.append(entry)
        self._window_bytes += entry.size_bytes
        headers = headers_of(record)
        if headers and ('bridge.origin', self._origin) in headers:
            entry.outcome = Outcome.SKIPPED
            return
        try:
            entry.cdr = self._decode(record.value())
        except RecordError as error:
            self._refuse(entry, record, headers, error)
        else:
            if self._ages:
                entry.timestamp = record.timestamp()
            self._pending.append(entry)

    def _refuse(
        self, entry: Entry, record: Record, headers: HeaderList | None, error: RecordError
    ) -> None:
        where = f'{self._route.source.kafka}[{entry.partition}]@{entry.offset}'
        if self._route.on_error == 'stop':
            text = f'{where}: {error}; stopped, as on_error says'
            entry.failure = RouteError(text, final=True)
            self._pending.append(entry)
            return
        self._occasional.warning(f'{self._route.on_error}: {where}: {error}')
        if self._route.on_error == 'drop':
            entry.outcome = Outcome.DROPPED
            return
        origin = from_kafka(
            self._route.name, self._route.source.kafka, entry.partition, entry.offset
        )
        letter = Outgoing('', record.key(), record.value(), headers or [])
        unread = '' if headers is not None else 'a name is not UTF-8'
        self._dead_letters.add(explain(letter, error, origin, unread), entry)

    # 2. entries -> ROS

    def _publish_pending(self, readers: Readers) -> str | None:
        """Publish what waits; tells what stands in the way, None when nothing is left."""
        if not self._pending:
            return self._no_room()
        if not self._enough(readers):
            return f'{readers.matched} of {self._route.min_subscribers} subscribers are there'
        pending, unconfirmed, publish = self._pending, self._unconfirmed, self._sink.publish
        while pending:
            entry = pending[0]
            if entry.failure is not None:
                return 'on_error: stop'
            if self._ages and self._expired(entry.timestamp):
                entry.outcome = Outcome.DROPPED
            elif not self._pace.go():
                return 'max_rate'
            elif not publish(entry.cdr):
                return 'the history is full: a subscriber does not take'
            else:
                unconfirmed.append(entry)
                self._nap_s = _SHORTEST_NAP_S
            pending.popleft()
        return self._no_room()

    def _no_room(self) -> str | None:
        """Tell what keeps the bridge from reading on, None if nothing does."""
        if self._dead_letters.problem:
            return self._dead_letters.problem
        if self._window_bytes > self._route.max_in_flight_bytes:
            return 'the window is full (max_in_flight_bytes)'
        return None

    def _enough(self, readers: Readers) -> bool:
        if readers.matched < self._route.min_subscribers:
            self._ready_at_s = None
            return False
        if self._route.min_subscribers == 0:
            return True
        # A writer knows of a match before the reader does; what it publishes meanwhile is lost.
        now_s = time.monotonic()
        if self._ready_at_s is None:
            self._ready_at_s = now_s + SETTLE_S
        return now_s >= self._ready_at_s

    def _wait(self, obstacle: str) -> None:
        now_s = time.monotonic()
        if self._blocked_since_s is None:
            self._blocked_since_s = now_s
        drops = self._route.when_full == 'drop_oldest' and not self._dead_letters.problem
        if drops and obstacle != 'max_rate':
            self._poll(_BUSY_S)
            self._drop_oldest()
        elif now_s - self._blocked_since_s > HOLD_AFTER_S:
            for record in self._source.hold():
                self._accept(record)
        if obstacle == 'max_rate':
            time.sleep(min(_LONGEST_NAP_S, self._pace.wait_s))
            return
        time.sleep(self._nap_s)
        self._nap_s = min(_LONGEST_NAP_S, self._nap_s * 2)

    def _drop_oldest(self) -> None:
        room_bytes = self._route.max_in_flight_bytes
        while (self._pending and self._pending[0].failure is None) and (
            len(self._pending) > self._route.max_in_flight or self._window_bytes > room_bytes
        ):
            self._pending.popleft().outcome = Outcome.DROPPED
            self._settle()

    # 3. confirmations -> positions -> commit

    def _confirm(self) -> Readers:
        readers = self._sink.readers()
        if readers.lost:
            self._ready_at_s = None  # another one may have come in its place just now
            self._publish_again()
        for _ in range(readers.confirmed - self._confirmed):
            entry = self._unconfirmed.popleft()
            if entry.outcome is None:
                entry.outcome = Outcome.CONFIRMED
        self._confirmed = readers.confirmed
        for entry in self._dead_letters.poll():
            entry.outcome = Outcome.DEAD_LETTERED
        return readers

    def _publish_again(self) -> None:
        again = [entry for entry in self._unconfirmed if entry.outcome is None]
        self._unconfirmed.clear()
        self._confirmed = 0
        self._pending.extendleft(reversed(again))
        self.counters.repeated += len(again)
        if again:
            self._log.warning(
                'a subscriber of %s has gone: %d messages that it had not acknowledged are '
                'published again',
                self._route.sink.ros, len(again),
            )  # fmt: skip

    def _settle(self) -> None:
        window, positions, end = self._window, self._positions, self.counters.end
        while window and (outcome := window[0].outcome) is not None:
            entry = window.popleft()
            self._window_bytes -= entry.size_bytes
            positions[entry.partition] = entry.offset + 1
            end(outcome)
        if not window:
            for partition, offset in self._source.ends.items():
                if positions.get(partition, offset) < offset:
                    positions[partition] = offset

    def _tick(self, obstacle: str | None) -> None:
        now_s = time.monotonic()
        if now_s >= self._commit_at_s:
            self._commit_at_s = now_s + COMMIT_S
            self._source.commit(self._positions)
        if now_s < self._tick_at_s:
            return
        self._tick_at_s = now_s + SNAPSHOT_S
        waiting = ''
        if self._blocked_since_s is not None and now_s - self._blocked_since_s > HOLD_AFTER_S:
            waiting = obstacle or ''
        self._show(waiting or self._source.away)

    def _show(self, reason: str) -> None:
        self.counters.tell(self._dead_letters.problem, reason)
        self.counters.lost_upstream = self._source.lost_upstream
        lag = self._source.lag(self._positions)
        self.snapshot = self.counters.snapshot(len(self._window), lag)

    # Hand-over, failure, end

    def revoked(self, partitions: frozenset[int]) -> None:
        """Wait for what these partitions have in flight, commit it, forget the rest."""
        deadline_s = time.monotonic() + REVOKE_S
        while time.monotonic() < deadline_s and self._has_unconfirmed(partitions):
            self._confirm()
            time.sleep(_BUSY_S)
        self._settle()
        self._source.commit_before_revoke(self._positions)
        self.lost(partitions)

    def lost(self, partitions: frozenset[int]) -> None:
        """Forget these partitions; others have them already."""
        self._give_back(lambda entry: entry.partition in partitions)
        for partition in partitions:
            self._positions.pop(partition, None)

    def _has_unconfirmed(self, partitions: frozenset[int]) -> bool:
        return any(e.outcome is None and e.partition in partitions for e in self._unconfirmed)

    def _give_back(self, condition: Callable[[Entry], bool]) -> None:
        """Return entries to Kafka: their offsets are not committed, they are read again."""
        kept: deque[Entry] = deque()
        for entry in self._window:
            if condition(entry):
                entry.outcome = Outcome.RETURNED
                self._window_bytes -= entry.size_bytes
                self.counters.end(Outcome.RETURNED)
            else:
                kept.append(entry)
        self._window = kept
        self._pending = deque(e for e in self._pending if e.outcome is None)

    def _drain(self, stop: Stop) -> None:
        deadline_s = time.monotonic() + self._route.drain_s
        self._give_back_pending()
        while self._window and time.monotonic() < deadline_s and not stop.at_once:
            self._confirm()
            self._give_back_pending()
            self._settle()
            time.sleep(_BUSY_S)
        left = len(self._window)
        patience_s = 0.0 if stop.at_once else max(1.0, deadline_s - time.monotonic())
        committed = self._source.commit_now(self._positions, patience_s)
        if left:
            self._log.warning(
                'gave up waiting for %d records in flight: they are read again next time', left
            )
        if not committed:
            self._log.warning('the last offsets are not committed: some records are repeated')

    def _give_back_pending(self) -> None:
        """Return what was not published, and what lies behind it: it is read again with it."""
        waiting = set(map(id, self._pending))
        holes: set[int] = set()

        def at_or_behind_a_hole(entry: Entry) -> bool:
            if id(entry) in waiting:
                holes.add(entry.partition)
            return entry.partition in holes

        if waiting:
            self._give_back(at_or_behind_a_hole)

    @contextmanager
    def _opened(self) -> Iterator[None]:
        self._source.open(self)
        try:
            yield
        finally:
            self._give_back(lambda _: True)
            self._source.commit_now(self._positions, _LAST_COMMIT_S)
            self._source.close()
            self._dead_letters.close()
            self._positions.clear()
            self.counters.lost_upstream = self._source.lost_upstream
            self.counters.tell_end()
            self.snapshot = self.counters.snapshot(len(self._window))
