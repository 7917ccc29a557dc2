"""The last minutes of each route: rates, percentiles of the last minute, points of spark lines."""

import threading
from collections import deque
from collections.abc import Collection, Iterable
from typing import Final, NamedTuple

from ros2_kafka_bridge.protocol.monitor import Report
from ros2_kafka_bridge.protocol.quantiles import percentiles
from ros2_kafka_bridge.route.counters import Snapshot

SPAN_S: Final = 600
BUCKET_S: Final = 5
_WINDOW_S: Final = 60
_RATE_S: Final = 5


class Point(NamedTuple):
    """A route at one moment.

    Args:
        time_s: Since 1970.
        rate: Carried a second, since the point before; None where there is none.
        held: The lag of a route from Kafka; what another has in flight and on disk. None while
            that is not known.
    """

    time_s: float
    rate: float | None
    held: int | None


class RouteStatistics(NamedTuple):
    """A route in the last seconds; None where that is not known yet.

    Args:
        rate: Carried a second.
        bytes_rate: Bytes carried a second.
        delay: The 50th and 99th percentile in seconds; None also where nothing came on.
        in_bridge: The same.
        end_to_end: The same.
        round_trip: The same.
        waited: Share of the time in which the sink held the route back.
    """

    rate: float | None = None
    bytes_rate: float | None = None
    delay: tuple[float, float] | None = None
    in_bridge: tuple[float, float] | None = None
    end_to_end: tuple[float, float] | None = None
    round_trip: tuple[float, float] | None = None
    waited: float | None = None


class _Track(NamedTuple):
    points: deque[Point]
    snapshots: deque[tuple[float, Snapshot]]


class History:
    """What reports have told of each route; those that are gone are forgotten."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tracks: dict[str, _Track] = {}

    def add(self, report: Report, readers: Collection[str] = ()) -> None:
        """Take a report.

        Args:
            report: What the supervisor told.
            readers: The routes from Kafka: what they hold is their lag, and nothing else.
        """
        with self._lock:
            before = self._tracks
            self._tracks = {}
            for told in report.routes:
                name = told.snapshot.route
                track = before.get(name) or _Track(deque(maxlen=SPAN_S), deque())
                if told.age_s is None:
                    track.snapshots.clear()  # whoever runs it now has told nothing
                else:
                    held = _held(told.snapshot, readers)
                    _extend(track, report.time_s, told.snapshot, held)
                self._tracks[name] = track

    def recent(self, route: str) -> RouteStatistics:
        """A route in the last seconds: rates of five, percentiles of sixty."""
        with self._lock:
            track = self._tracks.get(route)
            seen = list(track.snapshots) if track else []
        if len(seen) < 2:
            return RouteStatistics()
        now_s, now = seen[-1]
        # After a gap in the reports, the one before it.
        then_s, then = next((it for it in seen[:-1] if now_s - it[0] <= _RATE_S), seen[-2])
        passed_s = max(now_s - then_s, 0.001)
        first = seen[0][1].measures
        last = now.measures
        return RouteStatistics(
            rate=_gain(now.carried, then.carried) / passed_s,
            bytes_rate=_gain(last.bytes_carried, then.measures.bytes_carried) / passed_s,
            delay=percentiles(last.delay, first.delay),
            in_bridge=percentiles(last.in_bridge, first.in_bridge),
            end_to_end=percentiles(last.end_to_end, first.end_to_end),
            round_trip=percentiles(last.round_trip, first.round_trip),
            waited=min(1.0, _gain(last.waited_s, then.measures.waited_s) / passed_s),
        )

    def spark(self, route: str) -> list[tuple[int, int | None, int | None]]:
        """The last ten minutes in steps of five seconds: when, mean rate, most held."""
        with self._lock:
            track = self._tracks.get(route)
            points = list(track.points) if track else []
        buckets: dict[int, list[Point]] = {}
        for point in points:
            buckets.setdefault(int(point.time_s) // BUCKET_S * BUCKET_S, []).append(point)
        return [
            (at, _mean(p.rate for p in found), _most(p.held for p in found))
            for at, found in buckets.items()
        ]


def _held(now: Snapshot, readers: Collection[str]) -> int | None:
    if now.lag is not None or now.route in readers:
        return now.lag
    return None if now.spooled is None else now.in_flight + now.spooled


def _mean(rates: Iterable[float | None]) -> int | None:
    known = [rate for rate in rates if rate is not None]
    return round(sum(known) / len(known)) if known else None


def _most(held: Iterable[int | None]) -> int | None:
    return max((it for it in held if it is not None), default=None)


def _extend(track: _Track, time_s: float, snapshot: Snapshot, held: int | None) -> None:
    rate = None
    if track.snapshots and time_s <= track.snapshots[-1][0]:
        # The clock was set back: nothing from before can be compared with what comes.
        track.points.clear()
        track.snapshots.clear()
    if track.snapshots:
        then_s, then = track.snapshots[-1]
        rate = _gain(snapshot.carried, then.carried) / max(time_s - then_s, 0.1)
    track.points.append(Point(time_s, rate, held))
    track.snapshots.append((time_s, snapshot))
    while time_s - track.snapshots[0][0] > _WINDOW_S:
        track.snapshots.popleft()


def _gain(now: float, then: float) -> float:
    """What came on; what runs a route again after its process had died counts from 0."""
    return now - then if now >= then else now
