"""What the log says of every route every ten seconds."""

import time
from collections.abc import Callable, Iterable
from typing import Final

from ros2_kafka_bridge.logs import route_log
from ros2_kafka_bridge.metrics import Counters, Snapshot
from ros2_kafka_bridge.status import status_line

_PERIOD_S: Final = 10.0


class StatusLog:
    """A line for each route, again and again.

    Args:
        snapshots: Makes the counters of all routes.
    """

    def __init__(self, snapshots: Callable[[], Iterable[Snapshot]]) -> None:
        self._snapshots = snapshots
        self._before = {snapshot.route: snapshot for snapshot in snapshots()}
        self._said_s = time.monotonic()

    def say(self) -> None:
        """Say how every route is doing, unless that was said just now."""
        now_s = time.monotonic()
        period_s = now_s - self._said_s
        if period_s < _PERIOD_S:
            return
        now = {snapshot.route: snapshot for snapshot in self._snapshots()}
        for route, snapshot in now.items():
            before = self._before.get(route) or Counters(route).snapshot(0)
            line = status_line(snapshot, before, period_s)
            route_log(route).info('%s', line)
        self._before, self._said_s = now, now_s
