"""Writes the log to standard error, and holds nobody up where that is not read.

A terminal that was stopped with Ctrl-S, a pager, a log driver that has come to a halt: whoever
writes there waits for as long as it lasts. So a thread of its own writes. Who logs waits for it
only as long as a log that is read may take: what was said before a crash is out then.
"""

import logging
import os
import select
import sys
import threading
from collections import deque
from typing import Final, NamedTuple

from ros2_kafka_bridge.logs.text import count

STDERR: Final = 2
THREAD: Final = 'log'
_PATIENCE_S: Final = 0.2
_LAST_S: Final = 3.0
_MOST_BYTES: Final = 1024 * 1024


class _Line(NamedTuple):
    """A line that waits to be written.

    Args:
        data: With its end.
        left_out: How many before it were.
    """

    data: bytes
    left_out: int


class LogHandler(logging.Handler):
    """Writes lines in their order; of those that nobody reads it keeps a number of bytes.

    Any thread may use it, also one that logs in the middle of it, as a garbage collection may.

    Args:
        descriptor: Where to write.
        most_bytes: How much waits for a reader. What is beyond that is left out, and counted in
            the line after it.
    """

    def __init__(self, descriptor: int = STDERR, most_bytes: int = _MOST_BYTES) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._most_bytes = most_bytes
        self._encoding = getattr(sys.stderr, 'encoding', None) or 'utf-8'
        self._lines: deque[_Line] = deque()
        self._bytes = 0
        self._left_out = 0
        self._is_stuck = self._is_started = False
        self._changed = threading.Condition()

    def createLock(self) -> None:  # noqa: N802 (logging's name)
        """Have no lock of its own: who waits for a line to be out would hold it."""
        self.lock = None

    def handle(self, record: logging.LogRecord) -> bool:
        """Write a record, unless a filter is against it."""
        passed = self.filter(record)
        if passed:
            self.emit(record)
        return bool(passed)

    def emit(self, record: logging.LogRecord) -> None:
        """Have a line written; returns when it is out, or when that takes too long."""
        try:
            data = self._encoded(record)
            with self._changed:
                self._add(data)
                if not self._is_stuck:
                    self._is_stuck = not self._changed.wait_for(self._is_out, _PATIENCE_S)
        except Exception:  # noqa: BLE001 (as in every handler: a line of the log ends nothing)
            self.handleError(record)

    def flush(self) -> None:
        """Wait until all is written, or that takes too long; what was left out is told."""
        with self._changed:
            if self._left_out:
                self._append(b'')
            self._changed.wait_for(self._is_out, _LAST_S)

    def _encoded(self, record: logging.LogRecord) -> bytes:
        return f'{self.format(record)}\n'.encode(self._encoding, 'backslashreplace')

    def _add(self, data: bytes) -> None:
        if self._lines and self._bytes + len(data) > self._most_bytes:
            self._left_out += 1
        else:
            self._append(data)

    def _append(self, data: bytes) -> None:
        if not self._is_started:
            threading.Thread(target=self._write_all, name=THREAD, daemon=True).start()
            self._is_started = True
        self._lines.append(_Line(data, self._left_out))
        self._bytes += len(data)
        self._left_out = 0
        self._changed.notify_all()

    def _is_out(self) -> bool:
        return not self._lines

    # In the thread

    def _write_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines)
                line = self._lines[0]
            before = self._encoded(_note(line.left_out)) if line.left_out else b''
            is_written = _write(self._descriptor, before + line.data)
            with self._changed:
                if not is_written:
                    self._left_out += line.left_out + bool(line.data)
                self._bytes -= len(self._lines.popleft().data)
                self._is_stuck = self._is_stuck and bool(self._lines)
                self._changed.notify_all()


def _write(descriptor: int, line: bytes) -> bool:
    """Write a line, however long that takes; false where nobody can ever read it."""
    # Not through sys.stderr: its lock, held here, would break the end of the interpreter.
    while line:
        try:
            line = line[os.write(descriptor, line) :]
        except BlockingIOError:  # another program has set this for all who share it
            select.select([], [descriptor], [], 1.0)
        except OSError:  # the reader has gone, or the disk is full
            return False
    return True


def _note(left_out: int) -> logging.LogRecord:
    text = f'{count(left_out, "line")} of this log left out here: it could not be written'
    name = 'ros2_kafka_bridge'
    return logging.LogRecord(name, logging.WARNING, __file__, 0, text, None, None)
