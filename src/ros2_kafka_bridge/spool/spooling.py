"""The way over the disk: out of the window while Kafka does not take, back in order when it does.

window -> [written] -> backlog -> [loaded] -> window

What the disk does not take goes on without it, once nothing on disk is before it.
"""

import logging
import time
from collections.abc import Callable
from typing import Final

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.route.counters import Counters, Outcome
from ros2_kafka_bridge.route.message_window import MessageEntry, MessageWindow
from ros2_kafka_bridge.route.place import ASIDE, PENDING, REFUSED
from ros2_kafka_bridge.spool.already_sent import AlreadySent, InKafka
from ros2_kafka_bridge.spool.backlog import BATCH, Backlog, OnDisk
from ros2_kafka_bridge.spool.rows import Row, identity_of

_PATIENCE_S: Final = 1.0  # with a full window, before new messages go to disk


class Spooling:
    """Moves the entries of a route to disk and back; idle in a route without a spool.

    Args:
        route: The settings of the route.
        window: Where its entries are.
        put_in_line: Lets an entry go on to Kafka.
        backlog: What waits on disk.
        in_kafka: Tells what was produced before a restart.
        counters: Of the route.
        log: Where to say what happens.
    """

    def __init__(
        self,
        route: RosToKafkaRoute,
        window: MessageWindow,
        put_in_line: Callable[[MessageEntry], None],
        backlog: Backlog,
        in_kafka: InKafka,
        counters: Counters,
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self._drops = route.when_full == 'drop_oldest'
        self._window = window
        self._put_in_line = put_in_line
        self._backlog = backlog
        self._already_sent = AlreadySent(in_kafka, counters, log)
        self._counters = counters
        self._log = log
        self._occasional = summed(log)
        self._unwritten: list[MessageEntry] = []  # to be on disk; those in line may end before
        self._full_since_s: float | None = None
        self.loaded_bytes = 0  # of values that an earlier life has left and that were loaded
        self._loaded_last = 0  # number of the last of them

    @property
    def exists(self) -> bool:
        """Whether the route has a spool."""
        return self._backlog.exists

    @property
    def takes(self) -> bool:
        """Whether there is one, with room."""
        return self.exists and not self.full

    @property
    def active(self) -> bool:
        """Whether new messages go to disk."""
        return self._backlog.active

    @property
    def waiting(self) -> int:
        """How many messages are on disk and not in the window."""
        return self._backlog.waiting

    @property
    def on_disk(self) -> OnDisk:
        """What waits on disk."""
        return self._backlog.on_disk

    @property
    def size_bytes(self) -> int:
        """What the messages on disk are accounted for."""
        return self._backlog.size_bytes

    @property
    def full(self) -> str:
        """Why the disk takes no more; empty where it does."""
        return self._backlog.full or (self._backlog.problem if self._unwritten else '')

    # A life

    def claim(self) -> None:
        """Keep the spool for this process until `let_go`, also between two runs.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        self._backlog.claim()

    def let_go(self) -> None:
        """Leave the spool to any process."""
        self._backlog.let_go()

    def open(self) -> int:
        """Open the spool; returns the highest number that is in use there."""
        self._unwritten = []
        found, lost = self._backlog.open()
        self._counters.taken += found
        self._lose(lost)
        self._already_sent.begin(self._backlog.numbers(), found=found)
        return self._backlog.last

    def close(self) -> None:
        """Leave on disk what only this process holds, and close the spool."""
        if not self._backlog.is_open:
            return
        try:
            self._leave_in_flight()
        finally:
            self._backlog.close()

    def leave(self) -> None:
        """Leave on disk what is in flight, for good: the next life of the bridge sends it."""
        self._leave_in_flight()
        if self.waiting:
            text = counted(self.waiting, 'message')
            self._log.info('%s in the spool: sent at the next start', text)

    def _leave_in_flight(self) -> None:
        self._keep()
        held = [entry for entry in self._window.ascending() if entry.is_on_disk]
        kept, again = self._backlog.leave([entry.number for entry in held])
        for entry in held:
            if entry.number in kept:
                self._window.remove(entry)
        self._counters.taken += max(0, again)
        self._lose(-min(0, again))

    # When messages go to disk

    def step(self, away: str, letters: str = '') -> None:
        """Look whether messages have to go to disk, or can come back.

        Args:
            away: Why Kafka does not take; empty while it does.
            letters: Why it does not take dead letters.
        """
        if not self.exists:
            return
        self.begin_if_stuck(away or letters)
        self._backlog.release(self._window.entries)
        if self.active:
            self.write()
            self._load()
            self._drop()
            if not away:
                self._go_past()
            if not self._stuck(away or letters) and not self._behind():
                self._end_if_empty()

    def begin_if_stuck(self, away: str) -> None:
        """Let new messages go to disk, where Kafka is away or does not keep up."""
        if self.exists and not self.active and (reason := self._stuck(away)):
            self.begin(reason)

    def _stuck(self, away: str) -> str:
        """Why messages should not wait for Kafka in memory; empty while they may."""
        if away and len(self._window):
            return away
        now_s = time.monotonic()
        if self._window.room:
            self._full_since_s = None
        elif self._full_since_s is None:
            self._full_since_s = now_s
        elif now_s - self._full_since_s > _PATIENCE_S:
            return 'the window is full: Kafka takes too slowly'
        return ''

    def begin(self, reason: str) -> None:
        """Write down also what is in flight: while Kafka is away, a crash would lose it."""
        self._backlog.begin(reason)
        self._leave_the_line()
        self._unwritten = self._only_in_memory()
        self.write()

    def _end_if_empty(self) -> None:
        self._backlog.end_if_empty()
        if not self.active:
            self._unwritten = []

    def _leave_the_line(self) -> None:
        """Let wait on disk what the producer has not got, if it is behind all that it has."""
        pending = self._window.pending
        entries = self._window.entries.values()
        last = max((e.number for e in entries if e.place is not PENDING), default=0)
        last = max(last, self._backlog.last)  # what came from there is not written once more
        while pending and pending[-1].number > last:
            pending.pop().place = ASIDE

    def _only_in_memory(self) -> list[MessageEntry]:
        entries = self._window.ascending()
        first = self._backlog.last
        return [
            entry
            for entry in entries
            if not entry.is_on_disk and entry.place is not REFUSED and entry.number > first
        ]

    # Window -> disk

    @property
    def room(self) -> int:
        """How many messages may be taken while they go to disk."""
        if self._drops:
            return BATCH
        return 0 if self._unwritten or self.full else min(BATCH, self._backlog.room)

    def add(self, entry: MessageEntry) -> None:
        """Let an entry of the window be written next."""
        self._unwritten.append(entry)

    def write(self) -> None:
        """Write what has to be on disk; what finds nothing waiting there goes on at once."""
        if self._unwritten:
            window = self._window
            fits = len(window) <= window.max_entries and window.size_bytes <= window.max_bytes
            self._write(stays=fits and not self.waiting, go_on=True)

    def keep(self) -> bool:
        """Write what is in flight; tells whether all of it is on disk."""
        self._keep()
        return all(entry.is_on_disk for entry in self._window.entries.values())

    def _keep(self) -> None:
        if self.exists:
            self._unwritten = self._only_in_memory()
            self._write(stays=not self.waiting, go_on=False)

    def _write(self, *, stays: bool, go_on: bool) -> None:
        """Write entries behind the others.

        Args:
            stays: Whether they stay in the window, too. Those in line do.
            go_on: Whether those that stay go on to Kafka.
        """
        entries = [entry for entry in self._unwritten if entry.number in self._window.entries]
        rows = [_row_of(entry) for entry in entries]
        if rows and not self._backlog.write(rows, at_once=not go_on):
            return
        self._unwritten = []
        both = zip(rows, entries, strict=True)
        self._backlog.note_in_window([row for row, entry in both if stays or entry.is_in_line])
        for entry in entries:
            entry.is_on_disk = True
            if not stays and not entry.is_in_line:
                self._window.remove(entry)
            elif go_on and not entry.is_in_line:
                self._put_in_line(entry)

    def _behind(self) -> list[MessageEntry]:
        """What is not written and not in line either."""
        held = self._window.entries
        return [
            entry for entry in self._unwritten if not entry.is_in_line and entry.number in held
        ]

    def _go_past(self) -> None:
        """Let go on what the disk does not take, where nothing on it is before that."""
        if not self._unwritten or not self._backlog.lets_past:
            return
        room, room_bytes = self._room_in_line()
        for entry in self._behind():
            if room <= 0 or room_bytes <= 0:
                return
            self._put_in_line(entry)
            room -= 1
            room_bytes -= entry.size_bytes

    def holds_before(self, number: int) -> bool:
        """Whether a message before that one has not ended."""
        if min(self._window.entries, default=number) < number:
            return True
        return self._backlog.waits_before(number)

    def resume(self, entry: MessageEntry) -> None:
        """Take an entry that a failed run has left: behind what is on disk, or in line."""
        if entry.place is REFUSED:
            return
        if self.active:
            entry.place = ASIDE
            self._unwritten.append(entry)
        else:
            self._put_in_line(entry)

    # Disk -> window

    def _load(self) -> None:
        if not self.waiting:
            return
        room, room_bytes = self._room_in_line()
        room = min(room, self._already_sent.room(BATCH))
        rows, lost = self._backlog.load(room, room_bytes, self._window.ends_at)
        self._lose(lost)
        if rows:
            self._already_sent.note_loaded()
        for row in rows:
            is_earlier = row.number <= self._backlog.last_of_earlier
            if is_earlier and row.number > self._loaded_last:
                self._loaded_last = row.number
                self.loaded_bytes += len(row.record.value or b'')
            if is_earlier and self._already_sent.settles(row):
                self._counters.end(Outcome.SKIPPED)
                continue
            entry = _entry_of(row, self._backlog.age_s(row))
            self._window.put_back(entry)
            self._put_in_line(entry)

    def _room_in_line(self) -> tuple[int, int]:
        """How many entries the line has room for, and how many bytes."""
        # What cannot be written, or waits behind a failure, must not keep out what is before it.
        in_line = [entry.size_bytes for entry in self._window.entries.values() if entry.is_in_line]
        return self._window.max_entries - len(in_line), self._window.max_bytes - sum(in_line)

    # What does not come back

    def _lose(self, count: int) -> None:
        if count:
            self._log.error('%s in the spool cannot be read: lost', counted(count, 'message'))
            self._counters.end(Outcome.LOST, count)

    def _drop(self) -> None:
        if dropped := self._backlog.drop():
            self._occasional.warning(f'drop: {counted(dropped, "message")} of the spool')
            self._counters.end(Outcome.DROPPED, dropped)

    def drop_excess(self) -> None:
        """Keep the newest of what the disk does not take, where the route asks for it."""
        if not self._drops:
            return
        window, behind = self._window, self._behind()
        excess = len(behind) - window.max_entries
        for entry in behind:
            if excess <= 0 and window.size_bytes <= window.max_bytes:
                break
            window.remove(entry)
            self._counters.end(Outcome.DROPPED)
            excess -= 1
        self._unwritten = [entry for entry in self._unwritten if entry.number in window.entries]


def _row_of(entry: MessageEntry) -> Row:
    """What of an entry is written to disk."""
    return Row(entry.number, time.time_ns(), entry.is_letter, entry.gid, entry.seq, entry.record)


def _entry_of(row: Row, age_s: float) -> MessageEntry:
    """An entry that was on disk."""
    value = row.record.value or b''  # its length stands for that of the message
    message = Message(value, row.gid, row.seq, identity_of(row).source_time_ns)
    entry = MessageEntry(row.number, row.record, message, time.monotonic() - age_s)
    entry.is_letter, entry.is_on_disk = row.dead, True
    return entry
