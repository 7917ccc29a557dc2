"""The way over the disk: out of the flight while Kafka does not take, back in order when it does.

    tail -> [written] -> backlog -> [loaded] -> line

What the disk does not take goes on without it, once nothing on disk is before it.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.logs.lines import Log, summed
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.route.counters import Counters, Outcome
from ros2_kafka_bridge.route.flight.messages import MessageEntry, MessageFlight
from ros2_kafka_bridge.route.flight.stage import REFUSED
from ros2_kafka_bridge.route.obstacle import KAFKA_IS_SLOW
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.status import tell_dropped
from ros2_kafka_bridge.spool.already_sent import AlreadySent
from ros2_kafka_bridge.spool.backlog import BATCH, Backlog
from ros2_kafka_bridge.spool.rows import Row, identity_of

_PATIENCE_S: Final = 1.0  # with a full flight, before new messages go to disk


class OnDisk(NamedTuple):
    """What waits on disk; None where the file was never opened, and may hold anything.

    Args:
        messages: How many wait.
        size_bytes: What they are accounted for.
    """

    messages: int | None
    size_bytes: int | None


class Spooling:
    """Moves the entries of a route to disk and back; idle in a route without a spool.

    Args:
        route: The settings of the route.
        flight: Where its entries are.
        backlog: What waits on disk; None in a route without a spool.
        in_kafka: Tells what was produced before a restart.
        counters: Of the route.
        log: Where to say what happens.
    """

    def __init__(
        self,
        route: RosToKafkaRoute,
        flight: MessageFlight,
        backlog: Backlog | None,
        in_kafka: Produced,
        counters: Counters,
        log: Log,
    ) -> None:
        self.active = False  # whether new messages go to disk
        self.loaded_bytes = 0  # of values that an earlier life has left and that were loaded
        self._backlog = backlog
        self._drops = route.drops
        self._flight = flight
        self._already_sent = AlreadySent(in_kafka, counters, log)
        self._counters = counters
        self._log = log
        self._occasional = summed(log)
        self._since_s = 0.0  # new messages go to disk
        self._full_since_s: float | None = None
        self._loaded_last = 0  # number of the last row of an earlier life that was loaded
        self._last_row: int | None = None  # of those before what ends the route

    @property
    def exists(self) -> bool:
        """Whether the route has a spool."""
        return self._backlog is not None

    @property
    def takes(self) -> bool:
        """Whether there is a spool, with room."""
        return self._backlog is not None and not self.full

    @property
    def waiting(self) -> int:
        """How many messages are on disk and not in flight."""
        return self._backlog.waiting if self._backlog is not None else 0

    @property
    def on_disk(self) -> OnDisk:
        """What waits on disk."""
        if (backlog := self._backlog) is None:
            return OnDisk(0, 0)
        if not backlog.is_known:
            return OnDisk(None, None)
        return OnDisk(backlog.waiting, backlog.spool.size_bytes)

    @property
    def full(self) -> str:
        """Why the disk takes no more; empty where it does."""
        if self._backlog is None:
            return ''
        return self._backlog.full or (self._backlog.problem if self._lags else '')

    # A life

    def open(self) -> None:
        """Open the spool.

        Raises:
            RouteError: It cannot be used.
        """
        if (backlog := self._backlog) is None:
            return
        found, lost = backlog.open()
        self.active = self.active or backlog.always or backlog.waiting > 0
        if found > lost:
            self._since_s = time.monotonic()
            self._log.info('the spool holds %s from before', counted(found - lost, 'message'))
        self._counters.taken += found
        self._lose(lost)
        self._already_sent.begin(backlog.spool.numbers(), found=found)

    def close(self) -> None:
        """Leave on disk what only this process holds, and close the spool."""
        if self._backlog is None or not self._backlog.spool.is_open:
            return
        try:
            self._leave_in_flight(self._backlog)
        finally:
            self._backlog.spool.close()

    def leave(self) -> None:
        """Leave on disk what is in flight, for good: the next life of the bridge sends it."""
        if self._backlog is None:
            return
        self._leave_in_flight(self._backlog)
        if self.waiting:
            text = counted(self.waiting, 'message')
            self._log.info('%s in the spool: sent at the next start', text)

    def _leave_in_flight(self, backlog: Backlog) -> None:
        self.keep()
        flight = self._flight
        held = [entry for entry in flight if entry.row]
        kept, again = backlog.leave([entry.row for entry in held])
        flight.store([entry for entry in held if entry.row in kept])
        flight.forget_rows()
        flight.begin_again(behind_disk=True)
        self.active = self.active or backlog.waiting > 0
        self._counters.taken += max(0, again)
        self._lose(-min(0, again))

    # When messages go to disk

    def step(self, away: str, letters: str = '') -> None:
        """Look whether messages have to go to disk, or can come back.

        Args:
            away: Why Kafka does not take; empty while it does.
            letters: Why it does not take dead letters.
        """
        if (backlog := self._backlog) is None:
            return
        self._begin_if_stuck(away or letters)
        backlog.release(entry.row for entry in self._flight if entry.row)
        if self.active:
            self.write()
            self._load(backlog)
            self._drop(backlog)
            if not away:
                self._go_past(backlog)
            if not self._stuck(away or letters) and not any(self._flight.tail):
                self._end_if_empty(backlog)

    def make_room(self, away: str) -> None:
        """Let what is still taken go to disk while Kafka is away; one that is full is emptied."""
        if not self.takes:
            self.step(away)
        self._begin_if_stuck(away)

    def _begin_if_stuck(self, away: str) -> None:
        """Let new messages go to disk, where Kafka is away or does not keep up."""
        if self._backlog is not None and not self.active and (reason := self._stuck(away)):
            self.begin(reason)

    def _stuck(self, away: str) -> str:
        """Why messages should not wait for Kafka in memory; empty while they may."""
        if away and len(self._flight):
            return away
        now_s = time.monotonic()
        if self._flight.room:
            self._full_since_s = None
        elif self._full_since_s is None:
            self._full_since_s = now_s
        elif now_s - self._full_since_s > _PATIENCE_S:
            return KAFKA_IS_SLOW
        return ''

    def begin(self, reason: str) -> None:
        """Write down also what is in flight: while Kafka is away, a crash would lose it."""
        self.active = True
        self._since_s = time.monotonic()
        self._log.warning('new messages go to the spool: %s', reason)
        self._flight.hold_waiting()
        self.write()

    def _end_if_empty(self, backlog: Backlog) -> None:
        """Let new messages go past the disk again, if none waits there."""
        if not backlog.lets_past:
            return
        self.active = False
        backlog.problem = ''  # it is said again, should it last until the next time
        if self._since_s:
            took_s = time.monotonic() - self._since_s
            self._log.info('the spool is empty again, after %.0f s', took_s)

    # Flight -> disk

    @property
    def room(self) -> int:
        """How many messages may be taken while they go to disk."""
        if self._drops:
            return BATCH
        if self._backlog is None or self._lags or self._backlog.full:
            return 0
        return min(BATCH, self._backlog.room)

    @property
    def _lags(self) -> bool:
        """Whether something is to be on disk and is not."""
        return self.active and bool(self._flight.unwritten_line() or self._unwritten_tail())

    def _unwritten_tail(self) -> list[MessageEntry]:
        return [e for e in self._flight.tail if not e.row and e.stage is not REFUSED]

    def write(self) -> None:
        """Write what has to be on disk; what finds nothing waiting there goes on at once."""
        if not self.active:
            return
        tail = self._unwritten_tail()
        stays = self._flight.fits and not self.waiting
        if self._write(tail, stays=stays) and stays:
            for entry in _up_to_failure(self._flight.tail):
                self._flight.move_to_line(entry)

    def keep(self) -> bool:
        """Write all that is in flight; tells whether it is on disk."""
        if self._backlog is None:
            return False
        self._write(self._unwritten_tail(), stays=not self.waiting, at_once=True)
        return all(entry.row for entry in self._flight)

    def _write(self, tail: Sequence[MessageEntry], *, stays: bool, at_once: bool = False) -> bool:
        """Write entries behind the others on disk, those of the line first.

        Args:
            tail: What of the tail.
            stays: Whether that stays in flight, too, as the line does.
            at_once: Whether to try also where it was not possible just now.
        """
        line = self._flight.unwritten_line()
        entries = [*line, *tail]
        if self._backlog is None or not entries:
            return False
        rows = [self._row_of(entry) for entry in entries]
        in_flight = len(entries) if stays else len(line)
        first = self._backlog.write(rows, in_flight=in_flight, at_once=at_once)
        if not first:
            return False
        if not self._flight.ends:
            self._last_row = None
        elif self._last_row is None:
            before = [e for e in _up_to_failure(self._flight) if not e.row]
            self._last_row = first + len(before) - 1
        self._flight.note_rows(entries, first)
        if not stays:
            self._flight.store(tail)
        return True

    def _row_of(self, entry: MessageEntry) -> Row:
        """What of an entry is written to disk."""
        dead = entry.lane is self._flight.letters
        return Row(0, time.time_ns(), dead, entry.gid, entry.seq, entry.record)

    def _go_past(self, backlog: Backlog) -> None:
        """Let go on what the disk does not take, where nothing on it is before that."""
        if not backlog.lets_past:
            return
        room, room_bytes = self._room_in_line()
        for entry in _up_to_failure(self._flight.tail):
            if room <= 0 or room_bytes <= 0:
                return
            self._flight.move_to_line(entry)
            room -= 1
            room_bytes -= entry.size_bytes

    # Disk -> flight

    def _load(self, backlog: Backlog) -> None:
        flight = self._flight
        if not backlog.waiting or flight.line_ends:
            return
        room, room_bytes = self._room_in_line()
        # A letter tells nothing of the topic, and may stand for long.
        asks = any(entry.is_in_line and entry.lane is flight.lane for entry in flight.line)
        room = min(room, self._already_sent.room(BATCH, asks=asks))
        rows, lost = backlog.load(room, room_bytes, self._last_row if flight.ends else None)
        self._lose(lost)
        if rows:
            self._already_sent.note_loaded()
        for row in rows:
            if backlog.is_earlier(row):
                self._note_loaded(row)
                if self._already_sent.settles(row):
                    self._counters.end(Outcome.SKIPPED)
                    continue
            flight.load(_entry_of(row, backlog.age_s(row)), dead=row.dead)

    @property
    def waits_before_failure(self) -> bool:
        """Whether something on disk is before what ends the route."""
        if self._backlog is None or self._flight.line_ends:
            return False
        return self._backlog.waits(self._last_row)

    def _note_loaded(self, row: Row) -> None:
        if row.number > self._loaded_last:
            self._loaded_last = row.number
            self.loaded_bytes += len(row.record.value or b'')

    def _room_in_line(self) -> tuple[int, int]:
        """How many entries the line has room for, and how many bytes."""
        # What cannot be written, or waits behind a failure, must not keep out what is before it.
        in_line = [entry.size_bytes for entry in self._flight.line if entry.is_in_line]
        return self._flight.max_entries - len(in_line), self._flight.max_bytes - sum(in_line)

    # What does not come back

    def _lose(self, count: int) -> None:
        if count:
            self._log.error('%s in the spool cannot be read: lost', counted(count, 'message'))
            self._counters.end(Outcome.LOST, count)

    def _drop(self, backlog: Backlog) -> None:
        if dropped := backlog.drop():
            self._occasional.warning(f'drop: {counted(dropped, "message")} of the spool')
            self._counters.end(Outcome.DROPPED, dropped)

    def drop_excess(self) -> None:
        """Keep the newest of what the disk does not take, where the route asks for it."""
        if not self._drops:
            return
        dropped = self._flight.excess(self._unwritten_tail(), self._flight.max_bytes)
        self._flight.end(dropped, Outcome.DROPPED)
        tell_dropped(len(dropped), self._occasional)


def _up_to_failure(entries: Iterable[MessageEntry]) -> Iterator[MessageEntry]:
    """Those before what ends the route."""
    return takewhile(lambda entry: entry.stage is not REFUSED, entries)


def _entry_of(row: Row, age_s: float) -> MessageEntry:
    """An entry that was on disk."""
    value = row.record.value or b''  # its length stands for that of the message
    message = Message(value, row.gid, row.seq, identity_of(row).source_time_ns)
    return MessageEntry(row.record, message, time.monotonic() - age_s, row.number)
