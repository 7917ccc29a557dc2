"""How a worker tells its supervisor how its routes are doing."""

import threading
import time
from collections.abc import Callable
from typing import Final, Self

from ros2_kafka_bridge.process.lines import LineWriter
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
        self._snapshots = snapshots
        self._events = events
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send_often, name='snapshots', daemon=True)
        self._lock = threading.Lock()
        self._writer = LineWriter(pipe)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_LAST_S)
        deadline_s = time.monotonic() + _LAST_S
        self._tell(to_line(self._snapshots()))
        while self._writer.unsent and time.monotonic() < deadline_s:
            time.sleep(_BUSY_S)
            self._tell(b'')

    def send(self, event: Event) -> None:
        """Send what cannot wait, and the snapshots of that moment before it.

        A pipe without room gets it in time.
        """
        self._tell(to_line(self._snapshots()) + (wire.to_line(event) if self._events else b''))

    def _send_often(self) -> None:
        while not self._ended.wait(_PERIOD_S):
            self._tell(b'')
            if not self._writer.unsent:  # a slow reader misses some
                self._tell(to_line(self._snapshots()))

    def _tell(self, lines: bytes) -> None:
        with self._lock:
            self._writer.send(lines)
