"""Records how long the callback of a subscription takes, inside the node of the user.

It needs nothing but Python, so that one file can be copied to any robot.
"""

import inspect
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Self

HEADER: Final = '# ros2-kafka-bridge service times 1: arrival_ns start_ns end_ns missed'
_FLUSH_NS: Final = 1_000_000_000


class ServiceTimes:
    """Writes for each message when it arrived, and when its callback began and ended.

    ```python
    times = ServiceTimes('orders.times')
    node.create_subscription(Order, '/orders', times.timed(on_order), qos)
    ```

    One line for each message: `arrival_ns start_ns end_ns missed`, nanoseconds since 1970. The
    arrival is the message's source timestamp: the clock of its publisher. `missed` is how many
    messages of the same publisher never came to the callback, by their numbers; 0 where the
    middleware does not tell. The file is written once a second, and when it is closed or the
    program ends; one object times one subscription.

    Args:
        path: The file; one that is there is overwritten.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(self, path: Path | str) -> None:
        self._file = Path(path).open('w', encoding='utf-8')  # noqa: SIM115 (closed by `close`)
        self._file.write(f'{HEADER}\n')
        self._lock = threading.Lock()  # an executor may have several threads
        self._last_seq: dict[bytes, int] = {}
        self._flushed_ns = time.monotonic_ns()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Write what is left; callbacks that come later are still called, but not recorded."""
        with self._lock:
            self._file.close()

    def timed(self, callback: Callable[..., Any]) -> Callable[[Any, Mapping[str, Any]], None]:
        """Wrap a callback for `create_subscription`.

        It may take the message alone, or the message and its `MessageInfo`, as rclpy allows. A
        callback that raises is recorded, too.
        """
        takes_info = _takes_info(callback)

        def timed(message: Any, info: Mapping[str, Any]) -> None:
            # The wall clock may be set in the middle of it: only the start is read from it.
            start_ns, began_ns = time.time_ns(), time.monotonic_ns()
            try:
                callback(message, info) if takes_info else callback(message)
            finally:
                ended_ns = time.monotonic_ns()
                self._write(info, start_ns, start_ns + ended_ns - began_ns, ended_ns)

        return timed

    def _write(self, info: Mapping[str, Any], start_ns: int, end_ns: int, now_ns: int) -> None:
        with self._lock:
            if self._file.closed:
                return
            missed = self._missed(info)
            self._file.write(f'{info["source_timestamp"]} {start_ns} {end_ns} {missed}\n')
            if now_ns - self._flushed_ns > _FLUSH_NS:
                self._file.flush()
                self._flushed_ns = now_ns

    def _missed(self, info: Mapping[str, Any]) -> int:
        """How many messages of this publisher lie between its last one and this one."""
        seq = info.get('publication_sequence_number') or 0
        gid = info.get('publisher_gid')
        if not seq or not gid:
            return 0
        publisher = bytes(gid['data'])
        last = self._last_seq.get(publisher, seq - 1)
        self._last_seq[publisher] = max(last, seq)
        return max(0, seq - last - 1)


def _takes_info(callback: Callable[..., Any]) -> bool:
    """Whether rclpy would call it with the message's info: where the message alone is too few."""
    try:
        inspect.signature(callback).bind(object())
    except TypeError:
        return True
    return False
