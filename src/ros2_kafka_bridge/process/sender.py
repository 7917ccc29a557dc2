"""How a worker tells its supervisor how its routes are doing."""

import contextlib
import os
import stat
import threading
import time
from collections.abc import Callable
from typing import Final, Self

from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import Event
from ros2_kafka_bridge.route.counters import Snapshot, to_line

_PERIOD_S: Final = 1.0
_LAST_S: Final = 1.0
_BUSY_S: Final = 0.01


class SnapshotSender:
    """Sends snapshots once a second, from a thread, and a last time at the end of `with`.

    A lock keeps the lines whole: a route may send one from its own thread.

    Args:
        pipe: Where they go.
        snapshots: Makes them.
        events: Whether what happens is sent, too.
    """

    def __init__(
        self, pipe: int, snapshots: Callable[[], list[Snapshot]], *, events: bool = False
    ) -> None:
        self._pipe = pipe
        self._snapshots = snapshots
        self._events = events
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send_often, name='snapshots', daemon=True)
        self._lock = threading.Lock()
        self._rest = b''

    def __enter__(self) -> Self:
        mode = os.fstat(self._pipe).st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):  # a terminal is shared with others
            os.set_blocking(self._pipe, False)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_LAST_S)
        with contextlib.suppress(OSError):
            self._send_last()

    def tell(self, event: Event) -> None:
        """Send what cannot wait, and the snapshots of that moment before it.

        A pipe without room gets it in time.
        """
        with contextlib.suppress(OSError), self._lock:
            line = to_line(self._snapshots()) + (wire.to_line(event) if self._events else b'')
            left = self._send(line)
            if left:  # the rest of another came first
                left = self._send(left)
            self._rest += left

    def _send_often(self) -> None:
        with contextlib.suppress(OSError):  # nobody reads any more
            while not self._ended.wait(_PERIOD_S):
                with self._lock:
                    self._send(to_line(self._snapshots()))

    def _send_last(self) -> None:
        deadline_s = time.monotonic() + _LAST_S
        line = to_line(self._snapshots())
        while time.monotonic() < deadline_s:
            with self._lock:
                line = self._send(line)
                if not line and not self._rest:
                    return
            time.sleep(_BUSY_S)

    def _send(self, line: bytes) -> bytes:
        """Write the line, or first what is left of an older one; returns what was not begun."""
        data = self._rest or line
        try:
            written = os.write(self._pipe, data)
        except BlockingIOError:
            return line
        begun = not self._rest
        self._rest = data[written:]
        return b'' if begun else line
