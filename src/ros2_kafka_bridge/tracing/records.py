"""Spans of the records that go from Kafka to ROS."""

import random
import time
from collections import deque
from typing import Final, NamedTuple, TypeAlias

from ros2_kafka_bridge.endpoints import HeaderList, Record
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.records import RecordEntry
from ros2_kafka_bridge.route.trace_context import TraceContext, from_headers
from ros2_kafka_bridge.tracing.span import Attributes, EndSpan, Span, in_words, since_1970_ns

_MOST_OPEN: Final = 10_000
_PASSED_ON: Final = ('ros.gid', 'ros.seq', 'ros.source_time_ns')
_MOST_CHARS: Final = 64  # a bridge writes fewer


class NoRecordTraces:
    """Follows no record of a route, at no cost."""

    follow = False

    def begin(self, entry: RecordEntry, record: Record, headers: HeaderList | None) -> None:
        """Begin nothing."""

    def refused(self, entry: RecordEntry, error: RecordError) -> None:
        """Note nothing."""

    def look(self) -> None:
        """End nothing."""


NO_RECORD_TRACES: Final = NoRecordTraces()


class _Open(NamedTuple):
    entry: RecordEntry
    parent: TraceContext | None
    told: dict[str, str | int]


class SpansOfRecords:
    """Follows the records of a route: makes a span of each one that is sampled.

    A record is sampled where its `traceparent` says so; one without belongs to a trace of its
    own, sampled by the share. At most 10,000 are followed at a time.

    Args:
        topic: The Kafka topic.
        same: Attributes of all of them.
        sample: Share of the records without a `traceparent`.
        end: Takes the spans.
    """

    follow = True

    def __init__(self, topic: str, same: Attributes, sample: float, end: EndSpan) -> None:
        self._name = f'process {topic}'
        self._same = same
        self._sample = sample
        self._chance = random.random
        self._end = end
        self._open: deque[_Open] = deque()
        self._errors: dict[int, RecordError] = {}  # by id of the entry

    def begin(self, entry: RecordEntry, record: Record, headers: HeaderList | None) -> None:
        """Begin the span of a record that was just taken, if it is sampled.

        Args:
            entry: Which it is.
            record: As it came.
            headers: Of it, None where they cannot be read.
        """
        parent = from_headers(headers) if headers else None
        sampled = self._chance() < self._sample if parent is None else parent.sampled
        if sampled and len(self._open) < _MOST_OPEN:
            self._open.append(_Open(entry, parent, _told(record, headers or [])))

    def refused(self, entry: RecordEntry, error: RecordError) -> None:
        """Note why a record cannot be delivered, if it has a span."""
        if self._open and self._open[-1].entry is entry:
            self._errors[id(entry)] = error

    def look(self) -> None:
        """End the spans of the records that have ended, and all before them."""
        opened = self._open
        while opened and (outcome := opened[0].entry.outcome) is not None:
            self._close(opened.popleft(), outcome)

    def _close(self, span: _Open, outcome: Outcome) -> None:
        entry = span.entry
        error = self._errors.pop(id(entry), None)
        if outcome is Outcome.SKIPPED:  # it is the bridge's own: its span is that of its way here
            return
        attributes = {
            **self._same,
            'messaging.destination.partition.id': str(entry.partition),
            'messaging.kafka.offset': entry.offset,
            **span.told,
            'ros2_kafka_bridge.outcome': outcome,
        }
        self._end(
            Span(
                name=self._name,
                kind='consumer',
                context=None,
                parent=span.parent,
                start_ns=since_1970_ns(entry.taken_s),
                end_ns=time.time_ns(),
                attributes=attributes,
                error=in_words(error),
            )
        )


RecordTraces: TypeAlias = NoRecordTraces | SpansOfRecords


def _told(record: Record, headers: HeaderList) -> dict[str, str | int]:
    told: dict[str, str | int] = {'messaging.message.body.size': len(record.value() or b'')}
    for name, value in headers:
        if name in _PASSED_ON and value is not None and len(value) <= _MOST_CHARS:
            told[name] = value.decode(errors='replace') if isinstance(value, bytes) else value
    return told
