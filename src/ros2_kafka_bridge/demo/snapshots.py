"""Lines of counters that a process writes to a pipe of its parent, as the bridge's own."""

import os
import threading
import time
from collections.abc import Callable

from ros2_kafka_bridge.route.counters import Counters, Outcome, Snapshot, from_line, to_line

PERIOD_S = 1.0


class Count:
    """How many messages a node has moved, told to its parent once a second.

    Args:
        route: The name it goes by.
        descriptor: Of the open pipe; None tells nobody.
    """

    def __init__(self, route: str, descriptor: int | None) -> None:
        self.confirmed = 0
        self._route = route
        self._descriptor = descriptor

    def start(self) -> None:
        """Begin to tell, from a thread that ends with the process."""
        if self._descriptor is not None:
            threading.Thread(target=self._keep_telling, name='snapshots', daemon=True).start()

    def tell(self) -> None:
        """Tell the number of now; a parent that is gone ends this process."""
        if self._descriptor is None:
            return
        counters = Counters(self._route, taken=self.confirmed)
        counters.end(Outcome.CONFIRMED, counters.taken)
        try:
            os.write(self._descriptor, to_line([counters.snapshot(in_flight=0)]))
        except BrokenPipeError:
            os._exit(1)

    def _keep_telling(self) -> None:
        while True:
            self.tell()
            time.sleep(PERIOD_S)


def listen(descriptor: int, on_snapshot: Callable[[Snapshot], None]) -> None:
    """Hand out every snapshot that comes through a pipe, until its writers have closed it."""
    with open(descriptor, 'rb') as lines:
        for line in lines:
            for snapshot in from_line(line):
                on_snapshot(snapshot)
