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
from typing import Final

from ros2_kafka_bridge.logs.text import count

STDERR: Final = 2
_PATIENCE_S: Final = 0.2
_LAST_S: Final = 1.0
_MOST_BYTES: Final = 1024 * 1024


class LogHandler(logging.Handler):
    """Writes lines in their order; of those that nobody reads it keeps a number of bytes.

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
        self._lines: deque[bytes] = deque()
        self._bytes = 0
        self._left_out = 0
        self._is_stuck = self._is_started = False
        self._changed = threading.Condition()

    def emit(self, record: logging.LogRecord) -> None:
        """Have a line written; returns when it is out, or when that takes too long."""
        try:
            line = self._encoded(record)
            with self._changed:
                self._add(line)
                if not self._is_stuck:
                    self._is_stuck = not self._changed.wait_for(self._is_out, _PATIENCE_S)
        except Exception:  # noqa: BLE001 (as in every handler: a line of the log ends nothing)
            self.handleError(record)

    def flush(self) -> None:
        """Wait until all is written, as long as some of it is read."""
        with self._changed:
            left = None
            while self._lines and len(self._lines) != left:
                left = len(self._lines)
                self._changed.wait_for(lambda: len(self._lines) != left, _LAST_S)  # noqa: B023 (called at once)

    def _encoded(self, record: logging.LogRecord) -> bytes:
        return f'{self.format(record)}\n'.encode(self._encoding, 'backslashreplace')

    def _add(self, line: bytes) -> None:
        if self._lines and self._bytes + len(line) > self._most_bytes:
            self._left_out += 1
            return
        if self._left_out:
            line = self._encoded(_note(self._left_out)) + line
            self._left_out = 0
        self._lines.append(line)
        self._bytes += len(line)
        if not self._is_started:
            threading.Thread(target=self._write_all, name='log', daemon=True).start()
            self._is_started = True
        self._changed.notify_all()

    def _is_out(self) -> bool:
        return not self._lines

    # In the thread

    def _write_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines)
                line = self._lines[0]
            is_written = _write(self._descriptor, line)
            with self._changed:
                self._left_out += not is_written
                self._bytes -= len(self._lines.popleft())
                self._is_stuck = self._is_stuck and bool(self._lines)
                self._changed.notify_all()


def _write(descriptor: int, line: bytes) -> bool:
    """Write a line, however long that takes; false where nobody can ever read it."""
    # Not through sys.stderr: its lock, held here, would break the end of the interpreter.
    while line:
        try:
            line = line[os.write(descriptor, line) :]
        except BlockingIOError:  # another program has set this for all who share it
            select.select([], [descriptor], [], _LAST_S)
        except OSError:  # the reader has gone, or the disk is full
            return False
    return True


def _note(left_out: int) -> logging.LogRecord:
    text = f'{count(left_out, "line")} of this log left out here: nobody read it in time'
    name = 'ros2_kafka_bridge'
    return logging.LogRecord(name, logging.WARNING, __file__, 0, text, None, None)
