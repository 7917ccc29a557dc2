"""The rows of a route on disk: which of them are in flight, which wait, and which have ended.

The rows are of three kinds, in this order: those whose messages have ended and are not deleted
yet, those that are in flight, too, and those that wait. New messages go behind all of them, so
that the order of taking holds.
"""

import contextlib
import sys
import time
from collections.abc import Iterable, Sequence
from typing import Final

from ros2_kafka_bridge.config.settings import SpoolSettings
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.spool.ages import Ages
from ros2_kafka_bridge.spool.rows import Row
from ros2_kafka_bridge.spool.store import Spool

BATCH: Final = 500
_AGAIN_S: Final = 1.0
_RELEASE_S: Final = 0.2
_LOOK_S: Final = 1.0


class Backlog:
    """The disk side of one route from ROS.

    Args:
        spool: The file, not open yet.
        settings: What the route says of it.
        largest_bytes: How large a message may be.
        drops: Whether a full spool makes room by dropping the oldest (`when_full: drop_oldest`).
        log: Where to say what happens.
    """

    def __init__(
        self,
        spool: Spool,
        settings: SpoolSettings,
        log: Log,
        *,
        drops: bool = False,
        largest_bytes: int = 1,
    ) -> None:
        self.spool = spool
        self.always = settings.mode == 'always'  # all messages go there, whatever Kafka does
        self.waiting = 0  # rows that are not in flight
        self.problem = ''  # why nothing can be written just now
        self.is_known = False  # whether it was opened in this life
        self._settings = settings
        self._drops = drops
        self._largest_bytes = largest_bytes
        self._log = log
        self._ages = Ages()
        self._last_of_earlier = 0  # number of the last row of an earlier life
        self._loaded = 0  # number of the last row that is, or was, in flight
        self._again_at_s = 0.0
        self._release_at_s = 0.0
        self._look_at_s = 0.0

    @property
    def lets_past(self) -> bool:
        """Whether a message may go on without having been on disk: none waits there before it."""
        return not self.always and not self.waiting

    @property
    def room(self) -> int:
        """How many messages surely fit, at least one while there is any room."""
        return max(1, -self._excess_bytes // self._largest_bytes)

    @property
    def full(self) -> str:
        """Why no more messages fit; empty where some do."""
        # Only a message shows whether it still is so: one batch is taken to try.
        if self.problem and time.monotonic() < self._again_at_s:
            return self.problem
        if self._excess_bytes < 0:
            return ''
        return f'the spool is full (max_bytes: {self._settings.max_bytes})'

    @property
    def _excess_bytes(self) -> int:
        """By how much the spool is full; negative while there is room."""
        return self.spool.size_bytes - self._settings.max_bytes

    def open(self) -> tuple[int, int]:
        """Open the file.

        Returns:
            How many messages of an earlier life it holds, 0 where this life has opened it
            before, and how many cannot be read.

        Raises:
            RouteError: It cannot be used.
        """
        self.spool.open()
        lost = self.spool.take_lost()
        if self.is_known:
            return 0, self._count_again()
        self.is_known = True
        self._ages = Ages()
        self.waiting, self._last_of_earlier = self.spool.count, self.spool.last
        return self.waiting + lost, lost

    def _count_again(self) -> int:
        """Count what waits; returns how many are missing."""
        waited, self.waiting = self.waiting, self.spool.count_after(self._loaded)
        return max(0, waited - self.waiting)

    def is_earlier(self, row: Row) -> bool:
        """Whether an earlier life has written it."""
        return row.number <= self._last_of_earlier

    # Rows

    def write(self, rows: Sequence[Row], *, in_flight: int, at_once: bool) -> int:
        """Write rows behind the others.

        Args:
            rows: What to write.
            in_flight: How many of them, the first, stay in flight, too.
            at_once: Whether to try also where it was not possible just now.

        Returns:
            Number of the first; 0 where it is not possible now, as `problem` says.

        Raises:
            RouteError: It will not be possible, and somebody has to mend it.
        """
        assert not (in_flight and self.waiting), 'what waits is before them'
        now_s = time.monotonic()
        if now_s < self._again_at_s and not at_once:
            return 0
        self._ages.note(self.spool.last + 1)
        try:
            first = self.spool.append(rows)
        except TransportError as error:
            if not self.problem:
                self._log.error('%s; tried again until it can be', error)
            self.problem = str(error)
            self._again_at_s = now_s + _AGAIN_S
            return 0
        if self.problem:
            self._log.info('the spool can be written again')
        self.problem = ''
        self.waiting += len(rows) - in_flight
        if in_flight:
            self._loaded = first + in_flight - 1
        return first

    def load(self, limit: int, limit_bytes: int, last: int | None = None) -> tuple[list[Row], int]:
        """Take the next rows into flight.

        Args:
            limit: How many.
            limit_bytes: How large they may be.
            last: Number of the last one that may go.

        Returns:
            The rows, and how many were found to be unreadable.
        """
        if not self.waiting or limit <= 0 or limit_bytes <= 0:
            return [], 0
        found = self.spool.read(self._loaded, min(limit, BATCH), limit_bytes)
        rows = [row for row in found if last is None or row.number <= last]
        if rows:
            self._loaded = rows[-1].number
        self.waiting -= len(rows)
        # Of the rows that a repair found lost, those in flight are not.
        return rows, self._count_again() if self.spool.take_lost() or not found else 0

    def waits(self, last: int | None) -> bool:
        """Whether a row waits, up to a number."""
        if last is None or not self.waiting:
            return self.waiting > 0
        return any(row.number <= last for row in self.spool.read(self._loaded, 1, 1))

    def age_s(self, row: Row) -> float:
        """How long a row has waited on disk."""
        return self._ages.age_s(row.number, row.taken_ns)

    def release(self, in_flight: Iterable[int]) -> None:
        """Delete what has ended, now and then.

        Args:
            in_flight: The numbers of what has not, ascending.
        """
        now_s = time.monotonic()
        if self.spool.count and (now_s >= self._release_at_s or self._excess_bytes >= 0):
            self._release_at_s = now_s + _RELEASE_S
            self._delete(next(iter(in_flight), self._loaded + 1))

    def _delete(self, before: int) -> None:
        try:
            self.spool.delete_before(min(before, self._loaded + 1))
        except TransportError as error:
            self._log.warning('%s; what has been delivered is still in the spool', error)
            self._release_at_s = time.monotonic() + _AGAIN_S

    def leave(self, held: Sequence[int]) -> tuple[frozenset[int], int]:
        """Let what is in flight wait on disk again, at the end of a life.

        Args:
            held: The rows in flight, ascending.

        Returns:
            Those that still are on disk, and how many others that have ended could not be deleted
            and will be sent again; negative, how many were found to be unreadable.
        """
        self._delete(held[0] if held else self._loaded + 1)
        if not held:
            return frozenset(), 0
        with contextlib.suppress(TransportError):
            self.spool.discard_between(held[0], self._loaded, keep=frozenset(held))
        rows = self.spool.read(held[0] - 1, held[-1] - held[0] + 1, sys.maxsize)
        kept = frozenset(row.number for row in rows) & frozenset(held)
        before, self._loaded = self.waiting, held[0] - 1
        self.waiting = self.spool.count_after(self._loaded)
        return kept, self.waiting - before - len(kept)

    # Making room

    def drop(self) -> int:
        """Drop what is too old, and, if the route asks for it, the oldest of what is too much.

        Returns:
            How many rows were dropped.
        """
        if not self.waiting:
            return 0
        waited = self.waiting
        try:
            self._drop_old(self._settings.max_age_s)
            if self._drops and (excess_bytes := self._excess_bytes) >= 0:
                some_bytes = excess_bytes + self._settings.max_bytes // 20 + 1
                self.waiting -= self.spool.drop_oldest(self._loaded, some_bytes)
        except TransportError as error:  # a full disk has no room for the deleting, either
            self.problem = self.problem or str(error)
        return waited - self.waiting

    def _drop_old(self, max_age_s: float | None) -> None:
        now_s = time.monotonic()
        if max_age_s is None or now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _LOOK_S
        for older in self._ages.older_than(max_age_s, self.spool.last + 1):
            dropped, is_through = self.spool.drop_older(self._loaded, older)
            self.waiting -= dropped
            if not is_through:  # what is behind is younger
                return
