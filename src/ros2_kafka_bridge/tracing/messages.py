"""The trace of each message that goes from ROS to Kafka, and the spans of those sampled."""

import time
from collections.abc import Iterable
from typing import Final, TypeAlias

from ros2_kafka_bridge.endpoints import HeaderList, Message
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.messages import MessageEntry
from ros2_kafka_bridge.route.labels import MakeHeaders
from ros2_kafka_bridge.route.trace_context import TRACEPARENT, from_headers, traceparents
from ros2_kafka_bridge.tracing.span import Attributes, EndSpan, Span, in_words, since_1970_ns

_SAMPLED: Final = b'-01'
_ERROR: Final = 'dead_letter.error'


class NoMessageTraces:
    """Follows no message of a route."""

    def confirmed(self, entries: Iterable[MessageEntry]) -> None:
        """End nothing."""

    def ended(
        self, entry: MessageEntry, outcome: Outcome, error: RecordError | None = None
    ) -> None:
        """End nothing."""


NO_MESSAGE_TRACES: Final = NoMessageTraces()


def with_traceparent(make_headers: MakeHeaders, sample: float) -> MakeHeaders:
    """Let each message begin a trace: a `traceparent` behind its other headers.

    Args:
        make_headers: Makes the others, a new list each time.
        sample: Share of the traces that are sampled.
    """
    new = traceparents(sample).__next__

    def headers(message: Message) -> HeaderList:
        made = make_headers(message)
        made.append((TRACEPARENT, new()))
        return made

    return headers


class SpansOfMessages:
    """Follows the messages of a route: makes a span of each message that is sampled.

    Nothing is kept meanwhile: the headers hold the ids, also of a message that waits on disk.

    Args:
        topic: The Kafka topic.
        same: Attributes of all of them.
        end: Takes the spans.
    """

    def __init__(self, topic: str, same: Attributes, end: EndSpan) -> None:
        self._name = f'publish {topic}'
        self._same = same
        self._end = end

    def confirmed(self, entries: Iterable[MessageEntry]) -> None:
        """End the spans of a batch that Kafka has confirmed."""
        for entry in entries:
            headers = entry.record.headers
            if headers and headers[-1][0] == TRACEPARENT and _is_sampled(headers[-1][1]):
                self.ended(entry, Outcome.CONFIRMED)

    def ended(
        self, entry: MessageEntry, outcome: Outcome, error: RecordError | None = None
    ) -> None:
        """End the span of a message, by an error or without, if it is sampled."""
        headers = entry.record.headers
        context = from_headers(headers)
        if context is None or not context.sampled:
            return
        reason = dict(headers).get(_ERROR)
        attributes: dict[str, str | int] = {
            **self._same,
            'ros.gid': entry.gid.hex(),
            'ros.seq': entry.seq,
            'messaging.message.body.size': len(entry.record.value or b''),
            'ros2_kafka_bridge.outcome': outcome,
        }
        self._end(
            Span(
                name=self._name,
                kind='producer',
                context=context,
                parent=None,
                start_ns=since_1970_ns(entry.taken_s),
                end_ns=time.time_ns(),
                attributes=attributes,
                error=in_words(error) or _said(reason),
            )
        )


MessageTraces: TypeAlias = NoMessageTraces | SpansOfMessages


def _is_sampled(traceparent: str | bytes | None) -> bool:
    return traceparent is not None and traceparent[-3:] == _SAMPLED


def _said(reason: str | bytes | None) -> tuple[str, str] | None:
    """What a dead letter says of its error."""
    if reason is None:
        return None
    text = reason.decode(errors='replace') if isinstance(reason, bytes) else reason
    name, _, more = text.partition(': ')
    return name, more
