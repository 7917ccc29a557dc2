"""What of a route waits on disk: when messages go there, and which of them are back in memory.

The rows on disk are of three kinds, in this order: those whose messages have ended and are not
deleted yet, those that are in the window of the route, and those that wait. New messages go
behind all of them, so that the order of taking holds.
"""

import contextlib
import logging
import sys
import time
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.settings import SpoolSettings
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.spool.ages import Ages
from ros2_kafka_bridge.spool.store import Row, Spool

BATCH: Final = 500
_AGAIN_S: Final = 1.0
_RELEASE_S: Final = 0.2
_LOOK_S: Final = 1.0


class OnDisk(NamedTuple):
    """What waits on disk; None where the file was never opened, and may hold anything.

    Args:
        messages: How many wait.
        size_bytes: What they are accounted for.
    """

    messages: int | None
    size_bytes: int | None


class Backlog:
    """The disk side of one route from ROS; a route without a spool has one that is never used.

    Args:
        spool: The file, not open yet; None for a route without one.
        settings: What the route says of it.
        largest_bytes: How large a message may be.
        drops: Whether a full spool makes room by dropping the oldest (`when_full: drop_oldest`).
        log: Where to say what happens.
    """

    def __init__(
        self,
        spool: Spool | None,
        settings: SpoolSettings | None,
        log: logging.LoggerAdapter[logging.Logger],
        *,
        drops: bool = False,
        largest_bytes: int = 1,
    ) -> None:
        self.waiting = 0  # rows on disk that are not in the window
        self.last_of_earlier = 0  # number of the last row of an earlier life
        self.problem = ''  # why nothing can be written just now
        self.active = False  # whether new messages go to disk
        self._spool = spool
        self._settings = settings
        self._drops = drops
        self._largest_bytes = largest_bytes
        self._log = log
        self._ages = Ages()
        self._opened = False  # in this life
        self._is_open = False
        self._loaded = 0  # number of the last row that is, or was, in the window
        self._since_s = 0.0
        self._again_at_s = 0.0
        self._release_at_s = 0.0
        self._look_at_s = 0.0

    @property
    def exists(self) -> bool:
        """Whether the route has a spool."""
        return self._spool is not None

    @property
    def is_open(self) -> bool:
        """Whether the file is open."""
        return self._is_open

    @property
    def room(self) -> int:
        """How many messages surely fit, at least one while there is any room."""
        return max(1, -self._excess_bytes // self._largest_bytes)

    @property
    def size_bytes(self) -> int:
        """What the rows on disk are accounted for."""
        return self._spool.size_bytes if self._spool is not None else 0

    @property
    def on_disk(self) -> OnDisk:
        """What waits on disk."""
        if self._spool is not None and not self._opened:
            return OnDisk(None, None)
        return OnDisk(self.waiting, self.size_bytes)

    @property
    def last(self) -> int:
        """Number of the newest row."""
        return self._spool.last if self._spool is not None else 0

    def claim(self) -> None:
        """Keep the file for this process until `let_go`, also between two runs.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        if self._spool is not None:
            self._spool.claim()

    def let_go(self) -> None:
        """Leave the file to any process."""
        if self._spool is not None:
            self._is_open = False
            self._spool.let_go()

    def open(self) -> tuple[int, int]:
        """Open the file.

        Returns:
            How many messages of an earlier life it holds, 0 where this life has opened it
            before, and how many cannot be read.

        Raises:
            RouteError: It cannot be used.
        """
        if self._spool is None:
            return 0, 0
        self._spool.open()
        self._is_open = True
        lost = self._spool.take_lost()
        if self._opened:
            waited, self.waiting = self.waiting, self._spool.count_after(self._loaded)
            return 0, max(0, waited - self.waiting)
        self._opened = True
        self._ages = Ages()
        self.waiting, self.last_of_earlier = self._spool.count, self._spool.last
        self.active = self._always or self.waiting > 0
        if self.waiting:
            self._since_s = time.monotonic()
            self._log.info('the spool holds %s from before', counted(self.waiting, 'message'))
        return self.waiting + lost, lost

    def close(self) -> None:
        """Close the file."""
        if self._spool is not None:
            self._is_open = False
            self._spool.close()

    def numbers(self) -> Iterable[tuple[bytes, int]]:
        """Publisher and number of each message on disk, in their order."""
        return self._spool.numbers() if self._spool is not None else ()

    # When messages go to disk

    def begin(self, reason: str) -> None:
        """Let new messages go to disk from now on."""
        self.active = True
        self._since_s = time.monotonic()
        self._log.warning('new messages go to the spool: %s', reason)

    def end_if_empty(self) -> None:
        """Let new messages go past the disk again, if none waits there."""
        if self.active and self.lets_past:
            self.active = False
            self.problem = ''  # it is said again, should it last until the next time
            if self._since_s:
                took_s = time.monotonic() - self._since_s
                self._log.info('the spool is empty again, after %.0f s', took_s)

    @property
    def lets_past(self) -> bool:
        """Whether a message may go on without having been on disk: none waits there before it."""
        return not self._always and not self.waiting

    @property
    def _always(self) -> bool:
        return self._settings is not None and self._settings.mode == 'always'

    @property
    def full(self) -> str:
        """Why no more messages fit on the disk; empty where some do."""
        # Only a message shows whether it still is so: one batch is taken to try.
        if self.problem and time.monotonic() < self._again_at_s:
            return self.problem
        if self._spool is None or self._settings is None:
            return ''
        if self._excess_bytes < 0:
            return ''
        return f'the spool is full (max_bytes: {self._settings.max_bytes})'

    @property
    def _excess_bytes(self) -> int:
        """By how much the spool is full; negative while there is room."""
        assert self._spool is not None
        assert self._settings is not None
        return self._spool.size_bytes - self._settings.max_bytes

    # Rows

    def write(self, rows: Sequence[Row], *, at_once: bool = False) -> bool:
        """Write rows behind the others; False where that is not possible now, as `problem` says.

        Args:
            rows: What to write.
            at_once: Whether to try also where it was not possible just now.

        Raises:
            RouteError: It will not be possible, and somebody has to mend it.
        """
        now_s = time.monotonic()
        if self._spool is None or (now_s < self._again_at_s and not at_once):
            return False
        if rows:
            self._ages.note(rows[0].number)
        try:
            self._spool.append(rows)
        except TransportError as error:
            if not self.problem:
                self._log.error('%s; tried again until it can be', error)
            self.problem = str(error)
            self._again_at_s = now_s + _AGAIN_S
            return False
        if self.problem:
            self._log.info('the spool can be written again')
        self.problem = ''
        self.waiting += len(rows)
        return True

    def note_in_window(self, rows: Sequence[Row]) -> None:
        """Note that rows just written are in the window, too."""
        if rows:
            self.waiting -= len(rows)
            self._loaded = rows[-1].number

    def load(self, limit: int, limit_bytes: int, before: int) -> tuple[list[Row], int]:
        """Read the next rows into the window, those with numbers below `before`.

        Returns:
            The rows, and how many were found to be unreadable.
        """
        if self._spool is None or not self.waiting or limit <= 0 or limit_bytes <= 0:
            return [], 0
        found = self._spool.read(self._loaded, min(limit, BATCH), limit_bytes)
        rows = [row for row in found if row.number < before]
        if rows:
            self._loaded = rows[-1].number
        self.waiting -= len(rows)
        if not self._spool.take_lost() and found:
            return rows, 0
        # Of the rows that a repair found lost, those in the window are not.
        waited, self.waiting = self.waiting, self._spool.count_after(self._loaded)
        return rows, max(0, waited - self.waiting)

    def age_s(self, row: Row) -> float:
        """How long a row has waited on disk."""
        return self._ages.age_s(row.number, row.taken_ns)

    def waits_before(self, number: int) -> bool:
        """Whether a row of a lower number waits."""
        if self._spool is None or not self.waiting:
            return False
        return any(row.number < number for row in self._spool.read(self._loaded, 1, 1))

    def release(self, window: Iterable[int]) -> None:
        """Delete what has ended, now and then; `window` are the numbers of what has not."""
        now_s = time.monotonic()
        if self._spool is None or not self._spool.count:
            return
        if now_s >= self._release_at_s or self._excess_bytes >= 0:
            self._release_at_s = now_s + _RELEASE_S
            self._delete(min(window, default=self._loaded + 1))

    def _delete(self, before: int) -> None:
        assert self._spool is not None
        try:
            self._spool.release(min(before, self._loaded + 1))
        except TransportError as error:
            self._log.warning('%s; what has been delivered is still in the spool', error)
            self._release_at_s = time.monotonic() + _AGAIN_S

    def leave(self, held: Sequence[int]) -> tuple[frozenset[int], int]:
        """Let what is in the window wait on disk again, at the end of a life.

        Args:
            held: Numbers of the messages in the window that are on disk, ascending.

        Returns:
            Those that still are on disk, and how many others that have ended could not be deleted
            and will be sent again; negative, how many were found to be unreadable.
        """
        if self._spool is None:
            return frozenset(), 0
        self._delete(held[0] if held else self._loaded + 1)
        if not held:
            return frozenset(), 0
        with contextlib.suppress(TransportError):
            self._spool.discard_between(held[0], self._loaded, keep=frozenset(held))
        rows = self._spool.read(held[0] - 1, held[-1] - held[0] + 1, sys.maxsize)
        kept = frozenset(row.number for row in rows) & frozenset(held)
        before, self._loaded = self.waiting, held[0] - 1
        self.waiting = self._spool.count_after(self._loaded)
        self.active = self.active or self.waiting > 0
        return kept, self.waiting - before - len(kept)

    # Making room

    def drop(self) -> int:
        """Drop what is too old, and, if the route asks for it, the oldest of what is too much.

        Returns:
            How many rows were dropped.
        """
        if self._spool is None or self._settings is None or not self.waiting:
            return 0
        waited = self.waiting
        try:
            self._drop_old(self._settings.max_age_s)
            if self._drops and (excess_bytes := self._excess_bytes) >= 0:
                some_bytes = excess_bytes + self._settings.max_bytes // 20 + 1
                self.waiting -= self._spool.drop_oldest(self._loaded, some_bytes)
        except TransportError as error:  # a full disk has no room for the deleting, either
            self.problem = self.problem or str(error)
        return waited - self.waiting

    def _drop_old(self, max_age_s: float | None) -> None:
        now_s = time.monotonic()
        if max_age_s is None or now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _LOOK_S
        assert self._spool is not None
        for older in self._ages.older_than(max_age_s, self.last + 1):
            dropped, is_through = self._spool.drop_older(self._loaded, older)
            self.waiting -= dropped
            if not is_through:  # what is behind is younger
                return
