"""A span as the bridge makes it: whole, when it has ended."""

import time
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.route.trace_context import TraceContext

Attributes = Mapping[str, str | int]


class Span(NamedTuple):
    """What became of one record or message.

    Args:
        name: `<operation> <topic>`.
        kind: Its part in the traffic of Kafka.
        context: Its own ids; None where it has a parent, or begins a trace, and gets new ones.
        parent: What it is the child of; None where it begins a trace.
        start_ns: When it was taken, since 1970.
        end_ns: When it ended.
        attributes: By the conventions of OpenTelemetry for messaging, and the bridge's own.
        error: Class of the error and its text, None where there was none.
    """

    name: str
    kind: Literal['consumer', 'producer']
    context: TraceContext | None
    parent: TraceContext | None
    start_ns: int
    end_ns: int
    attributes: Attributes
    error: tuple[str, str] | None = None


EndSpan = Callable[[Span], None]
"""Takes a span that has ended, and never waits."""


def since_1970_ns(moment_s: float) -> int:
    """When a moment of the monotonic clock was."""
    return time.time_ns() - int(1e9 * (time.monotonic() - moment_s))


def in_words(error: RecordError | None) -> tuple[str, str] | None:
    """Class and text of an error."""
    return None if error is None else (type(error).__name__, str(error))
