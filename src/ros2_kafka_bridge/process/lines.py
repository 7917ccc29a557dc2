"""Lines through a pipe, between the processes of a bridge."""

import os
import stat
import time
from typing import Final

_CHUNK_BYTES: Final = 1024 * 1024  # no pipe holds more by default, whatever its pages
_LIMIT_BYTES: Final = 64 * 1024 * 1024


class LineWriter:
    """Writes lines, and never waits for whoever reads them.

    Args:
        descriptor: Of a pipe; anything else is written as it is.
    """

    def __init__(self, descriptor: int) -> None:
        self.unsent = b''
        self._descriptor = descriptor
        self._took_s = 0.0
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):  # a terminal is shared with others
            os.set_blocking(descriptor, False)

    @property
    def stuck_s(self) -> float:
        """For how long nothing was taken of what waits; 0 where nothing does."""
        return time.monotonic() - self._took_s if self.unsent else 0.0

    def send(self, lines: bytes) -> None:
        """Write lines, as far as there is room; the rest waits, and what comes after it."""
        if not self.unsent:
            self._took_s = time.monotonic()
        self.unsent += lines
        self.flush()

    def flush(self) -> None:
        """Write what waits, as far as there is room; what nobody will read is forgotten."""
        if not self.unsent:
            return
        try:
            written = os.write(self._descriptor, self.unsent)
        except BlockingIOError:
            return
        except OSError:
            written = len(self.unsent)
        self.unsent = self.unsent[written:]
        self._took_s = time.monotonic()


class LineReader:
    """Reads lines.

    Args:
        descriptor: Of a pipe.
        limit_bytes: How long a line may be; the beginning of a longer one is forgotten.
    """

    def __init__(self, descriptor: int, limit_bytes: int = _LIMIT_BYTES) -> None:
        self.has_ended = False
        self._descriptor = descriptor
        self._limit_bytes = limit_bytes
        self._rest = b''

    def read(self) -> list[bytes]:
        """The whole lines of what the pipe holds; one that blocks is waited for."""
        try:
            data = os.read(self._descriptor, _CHUNK_BYTES)
        except BlockingIOError:
            return []
        self.has_ended = not data
        *lines, rest = (self._rest + data).split(b'\n')
        self._rest = rest if len(rest) <= self._limit_bytes else b''
        return lines
