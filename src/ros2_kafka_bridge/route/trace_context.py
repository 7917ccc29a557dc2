"""W3C trace context (https://www.w3.org/TR/trace-context/) in the headers of records."""

import os
import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from ros2_kafka_bridge.endpoints import HeaderList

TRACEPARENT: Final = 'traceparent'
TRACESTATE: Final = 'tracestate'

_LENGTHS: Final = (len(TRACEPARENT), len(TRACESTATE))
_PARENT: Final = re.compile(
    rb'([0-9a-f]{2})-([0-9a-f]{32})-([0-9a-f]{16})-([0-9a-f]{2})(-.*)?', re.DOTALL
)
_NO_TRACE: Final = b'0' * 32
_NO_SPAN: Final = b'0' * 16
_INVALID: Final = b'ff'
_FIRST: Final = b'00'
_SAMPLED: Final = 0x01
_STATE_LIMIT_BYTES: Final = 4096  # the standard asks for 512 at least
_BATCH: Final = 256
_ID_BYTES: Final = 24  # of a trace and a span


class TraceContext(NamedTuple):
    """Where a record stands in a trace.

    Args:
        trace_id: 32 hex digits.
        span_id: Of the span that has written the record; 16 hex digits.
        sampled: Whether the spans of the trace are recorded.
        state: What other systems have added (`tracestate`).
    """

    trace_id: str
    span_id: str
    sampled: bool
    state: str = ''


def parse(traceparent: str | bytes | None) -> TraceContext | None:
    """Read a `traceparent`, also of a version to come; None where it is none by the standard."""
    given = traceparent.encode() if isinstance(traceparent, str) else traceparent or b''
    found = _PARENT.fullmatch(given)
    if found is None:
        return None
    version, trace_id, span_id, flags, more = found.groups()
    wrong = version == _INVALID or (version == _FIRST and more is not None)
    if wrong or trace_id == _NO_TRACE or span_id == _NO_SPAN:
        return None
    sampled = bool(int(flags, 16) & _SAMPLED)
    return TraceContext(trace_id.decode(), span_id.decode(), sampled)


def from_headers(headers: HeaderList) -> TraceContext | None:
    """Where a record stands in a trace; None without a valid `traceparent`, or with two."""
    parents, states = [], []
    for name, value in headers:
        if len(name) in _LENGTHS:  # a quick look first: this is done for every record
            # The standard wants the names written in lower case, and read in any.
            lower = name.lower()
            if lower == TRACEPARENT:
                parents.append(value)
            elif lower == TRACESTATE:
                states.append(_bytes(value))
    context = parse(parents[0]) if len(parents) == 1 else None
    if context is None or not states:
        return context
    state = b','.join(states)
    if len(state) > _STATE_LIMIT_BYTES or not state.isascii():
        return context
    return context._replace(state=state.decode())


def trace_id_of(headers: HeaderList | None) -> str | None:
    """The id of the trace that a record belongs to; None where it belongs to none."""
    context = from_headers(headers or [])
    return context and context.trace_id


def traceparents(sample: float, random: Callable[[int], bytes] = os.urandom) -> Iterator[bytes]:
    """Make the `traceparent` of one new trace after the other.

    The share is taken by the id of the trace, as OpenTelemetry does: who samples a larger share
    of the same traces has all of these.

    Args:
        sample: Share of the traces that are sampled, from 0 to 1.
        random: Makes random bytes.
    """
    bound = b'\xff' * 9 if sample >= 1 else int(sample * 2**64).to_bytes(8)
    while True:
        block = random(_BATCH * _ID_BYTES)
        digits = block.hex().encode()
        if _NO_SPAN in digits:  # no id may be nothing but zeros
            continue
        for at in range(0, len(block), _ID_BYTES):
            trace, span = at * 2, at * 2 + 32
            yield b'00-%b-%b-%b' % (
                digits[trace:span],
                digits[span : span + 16],
                b'01' if block[at + 8 : at + 16] < bound else b'00',
            )


def _bytes(value: str | bytes | None) -> bytes:
    return value.encode() if isinstance(value, str) else value or b''
