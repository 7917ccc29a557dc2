"""How a route measures itself: for a batch at a time, in its own thread."""

import time
from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import Load, Matches
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.route.counters import (
    BOUNDS_S,
    MOST_TROUBLES,
    Distribution,
    Measures,
    Outcome,
    Trouble,
)
from ros2_kafka_bridge.route.flight.messages import MessageEntry
from ros2_kafka_bridge.route.flight.records import RecordEntry

_TEXT_CHARS: Final = 1000
_S_PER_NS: Final = 1e-9


class Histogram:
    """A `Distribution` that grows."""

    def __init__(self) -> None:
        self._counts = [0] * (len(BOUNDS_S) + 1)
        self._sum_s = 0.0

    def add_since(self, starts: list[float] | list[int], now: float, unit_s: float = 1.0) -> None:
        """Add how long ago each of these was; a start in the future was just now.

        Args:
            starts: By any clock, as many as there are; sorted in place.
            now: By the same clock.
            unit_s: Of that clock, in seconds.
        """
        if not starts:
            return
        starts.sort()
        self._sum_s += max(0.0, (len(starts) * now - sum(starts)) * unit_s)
        youngest = bisect_left(BOUNDS_S, (now - starts[-1]) * unit_s)
        oldest = bisect_left(BOUNDS_S, (now - starts[0]) * unit_s)
        end = len(starts)
        for bucket in range(youngest, oldest):
            begin = bisect_left(starts, now - BOUNDS_S[bucket] / unit_s, 0, end)
            self._counts[bucket] += end - begin
            end = begin
        self._counts[oldest] += end

    def distribution(self) -> Distribution:
        """What it is now."""
        return Distribution(tuple(self._counts), self._sum_s)


class Troubles:
    """Counts errors by their class, and keeps the last different ones."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._last: dict[tuple[str, str], Trouble] = {}  # by class and text, the newest last

    def note(self, error: BridgeError, where: str = '') -> None:
        """Note an error.

        Args:
            error: What has happened.
            where: What it was about. Errors that differ in this alone are the same.
        """
        text = str(error)
        self._note(type(error).__name__, text, f'{where}: {text}' if where else text)

    def note_away(self, text: str, *, is_new: bool) -> None:
        """Note that the other side is away; one that is not new only says more of the last."""
        self._note('TransportError', text, text, times=int(is_new))

    def _note(self, error: str, key: str, text: str, times: int = 1) -> None:
        self._counts[error] = self._counts.get(error, 0) + times
        name = error, key[:_TEXT_CHARS]
        before = self._last.pop(name, None)
        times += before.times if before is not None else 0
        self._last[name] = Trouble(time.time(), error, text[:_TEXT_CHARS], max(1, times))
        if len(self._last) > MOST_TROUBLES:
            del self._last[next(iter(self._last))]

    def measures(self) -> Measures:
        """Only the errors."""
        return Measures(errors=dict(self._counts), troubles=tuple(self._last.values()))


class Meter:
    """What one route measures beside its counters; only the route's own thread touches it."""

    def __init__(self) -> None:
        self.bytes_taken = 0
        self.bytes_confirmed = 0
        self.bytes_published = 0
        self.waited_s = 0.0
        self.published = Histogram()
        self.in_bridge = Histogram()
        self.end_to_end = Histogram()
        self.round_trip = Histogram()
        self.troubles = Troubles()
        self.kafka_up: bool | None = None
        self._away = ''

    def look(self, away: str) -> None:
        """Note that the other side is away, once until it is back."""
        if away and away != self._away:
            self.troubles.note_away(away, is_new=not self._away)
        self._away = away

    def publish_records(self, entries: Sequence[RecordEntry]) -> None:
        """Measure records that were published just now."""
        self.published.add_since([entry.taken_s for entry in entries], time.monotonic())
        made_ms = [entry.made_ms for entry in entries if entry.made_ms > 0]
        self.end_to_end.add_since(made_ms, time.time() * 1000, 0.001)

    def confirm_records(self, confirmed: Sequence[RecordEntry]) -> None:
        """Measure a batch of records that ROS has confirmed."""
        size_bytes = sum([entry.value_bytes for entry in confirmed])
        self.bytes_taken += size_bytes
        self.bytes_confirmed += size_bytes
        self.in_bridge.add_since([entry.taken_s for entry in confirmed], time.monotonic())

    def end_record(self, entry: RecordEntry) -> None:
        """Measure a record that has ended otherwise."""
        self.bytes_taken += entry.value_bytes
        if entry.outcome is Outcome.PUBLISHED:
            self.bytes_published += entry.value_bytes

    def confirm_messages(self, confirmed: Sequence[MessageEntry]) -> None:
        """Measure a batch of messages that Kafka has confirmed."""
        if not confirmed:
            return
        now_s = time.monotonic()
        self.bytes_confirmed += sum([entry.taken_bytes for entry in confirmed])
        self.in_bridge.add_since([entry.taken_s for entry in confirmed], now_s)
        self.round_trip.add_since([entry.produced_s for entry in confirmed], now_s)
        made_s = [_S_PER_NS * entry.made_ns for entry in confirmed if entry.made_ns > 0]
        self.end_to_end.add_since(made_s, time.time())

    def measures(
        self,
        load: Load,
        matches: Matches,
        *,
        bytes_held: int = 0,
        rebalances: int = 0,
        spool_bytes: int | None = 0,
        broker_round_trip_s: tuple[float, float] | None = None,
    ) -> Measures:
        """Freeze what was measured, with what the ends of the route say just now.

        Args:
            load: Of the sink.
            matches: Of the ROS endpoint.
            bytes_held: Of what was taken and is not in `bytes_taken`.
            rebalances: Of the source.
            spool_bytes: Of the spool, None where it was not opened.
            broker_round_trip_s: Of the sink.
        """
        return self.troubles.measures()._replace(
            bytes_taken=self.bytes_taken + bytes_held,
            bytes_confirmed=self.bytes_confirmed,
            bytes_published=self.bytes_published,
            waited_s=self.waited_s,
            rebalances=rebalances,
            kafka_up=self.kafka_up,
            matched=matches.matched,
            mismatched=matches.mismatched,
            queued=load.queued,
            queue_limit=load.limit,
            spool_bytes=spool_bytes,
            published=self.published.distribution(),
            in_bridge=self.in_bridge.distribution(),
            end_to_end=self.end_to_end.distribution(),
            round_trip=self.round_trip.distribution(),
            broker_round_trip_s=broker_round_trip_s,
        )
