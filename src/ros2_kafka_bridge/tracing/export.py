"""Where spans go: to a collector by OTLP over HTTP, in a thread of its own.

The only place that imports OpenTelemetry.
"""

import logging
import math
import platform
import re
import threading
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

from opentelemetry import trace
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import ReadableSpan, SpanLimits, TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SpanExporter, SpanExportResult
from opentelemetry.sdk.trace.id_generator import IdGenerator, RandomIdGenerator
from opentelemetry.sdk.trace.sampling import ALWAYS_ON

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.logs.text import count, printable
from ros2_kafka_bridge.outside.masking import masked_address
from ros2_kafka_bridge.route.trace_context import TraceContext
from ros2_kafka_bridge.tracing.span import Span

MOST_WAITING: Final = 2048
"""Spans that wait for the collector; those that come while there are as many are left out."""

_BATCH: Final = 512
_PERIOD_S: Final = 1.0
_FLUSH_S: Final = 3.0
_SAID_AGAIN_S: Final = 60.0
_ERRNO: Final = re.compile(r'\[Errno -?\d+\] ([\w ,-]+)')
_STATUS: Final = re.compile(r'batch code: (\d+, reason: [\w ]+)')
_KINDS: Final = {'consumer': trace.SpanKind.CONSUMER, 'producer': trace.SpanKind.PRODUCER}
_SAMPLED: Final = trace.TraceFlags(trace.TraceFlags.SAMPLED)


class Service(NamedTuple):
    """What the spans of a process say of it.

    Args:
        name: `service.name`.
        bridge: Name of the bridge.
        worker: Number of this process among its workers; 0 where it is the only one.
    """

    name: str
    bridge: str
    worker: int


@contextmanager
def open_exporter(service: Service, endpoint: str | None, log: RouteLog) -> Iterator['Exporter']:
    """Send spans while the block runs, and what waits then for three seconds more.

    Args:
        service: Who sends them.
        endpoint: Where to; None asks the environment (`OTEL_EXPORTER_OTLP_*`).
        log: Where to say that the collector does not take them.
    """
    words = _FirstWords()
    logger = logging.getLogger('opentelemetry')
    before = logger.handlers, logger.propagate
    logger.handlers, logger.propagate = [words], False
    exporter = Exporter(service, endpoint, log, words)
    try:
        yield exporter
    finally:
        exporter.close()
        logger.handlers, logger.propagate = before


class Exporter:
    """Sends spans in batches; never holds the caller up.

    Args:
        service: Who sends them.
        endpoint: Where to; None asks the environment.
        log: Where to say that the collector does not take them.
        words: What OpenTelemetry has said.
    """

    def __init__(
        self, service: Service, endpoint: str | None, log: RouteLog, words: '_FirstWords'
    ) -> None:
        self._ids = _GivenIds()
        self._lock = threading.Lock()
        shown = masked_address(endpoint or 'the collector of OTEL_EXPORTER_OTLP_*')
        self._sender = _Sender(OTLPSpanExporter(endpoint), shown, log, words)
        self._provider = TracerProvider(
            sampler=ALWAYS_ON,
            resource=_resource(service),
            shutdown_on_exit=False,
            id_generator=self._ids,
            span_limits=SpanLimits(max_attribute_length=1000),
        )
        self._provider.add_span_processor(
            BatchSpanProcessor(
                self._sender,
                max_queue_size=2 * MOST_WAITING,
                schedule_delay_millis=_PERIOD_S * 1000,
                max_export_batch_size=_BATCH,
            )
        )
        self._tracer = self._provider.get_tracer('ros2_kafka_bridge', __version__)

    def end(self, span: Span) -> None:
        """Take a span that has ended; any thread may call."""
        if not self._sender.has_room():
            return
        with self._lock:
            self._ids.give(span.context)
            made = self._tracer.start_span(
                span.name,
                context=trace.set_span_in_context(_parent(span.parent)),
                kind=_KINDS[span.kind],
                attributes=span.attributes,
                start_time=span.start_ns,
            )
        if span.error is not None:
            name, text = span.error
            made.set_attribute('error.type', name)
            made.set_status(trace.StatusCode.ERROR, printable(f'{name}: {text}')[:1000])
        made.end(span.end_ns)

    def close(self) -> None:
        """Send what waits, for a few seconds at most."""
        thread = threading.Thread(target=self._provider.shutdown, daemon=True)
        thread.start()
        thread.join(_FLUSH_S)
        if thread.is_alive():
            self._sender.shutdown()  # ends the waiting between two attempts
            thread.join(1.0)
        self._sender.say_rest()


class _GivenIds(IdGenerator):
    """Gives a span the ids that are in a header already, else new ones."""

    def __init__(self) -> None:
        self._random = RandomIdGenerator()
        self._given: TraceContext | None = None

    def give(self, context: TraceContext | None) -> None:
        """Let the next span have these ids."""
        self._given = context

    def generate_span_id(self) -> int:
        """The given one, or a new one."""
        return int(self._given.span_id, 16) if self._given else self._random.generate_span_id()

    def generate_trace_id(self) -> int:
        """The same for a trace that begins here."""
        return int(self._given.trace_id, 16) if self._given else self._random.generate_trace_id()


class _FirstWords(logging.Handler):
    """Keeps what OpenTelemetry has said first of a failure, for one line of the bridge."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.text = ''

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        self.text = self.text or record.getMessage()


class _Sender(SpanExporter):
    """Hands batches on, and counts what is under way and what was lost."""

    def __init__(
        self, inner: SpanExporter, endpoint: str, log: RouteLog, words: _FirstWords
    ) -> None:
        self._inner = inner
        self._endpoint = endpoint
        self._words = words
        self._log = log
        self._said_s = -math.inf
        self._reason = ''
        self._lock = threading.Lock()
        self._waiting = 0
        self._left_out = 0
        self._closed = False

    def has_room(self) -> bool:
        """Whether one more may wait; counts it."""
        with self._lock:
            fits = self._waiting < MOST_WAITING
            self._waiting += fits
            self._left_out += not fits
        return fits

    def export(self, spans: Sequence[ReadableSpan]) -> SpanExportResult:
        """Send a batch; called by the thread of the processor."""
        self._words.text = ''
        closed = self._closed
        try:
            result = self._inner.export(spans)
        finally:
            with self._lock:
                self._waiting -= len(spans)
        lost = result is not SpanExportResult.SUCCESS
        with self._lock:
            self._left_out += len(spans) * lost
        if not closed:
            self._reason = _cause(self._words.text) if lost else ''
        if self._left_out and time.monotonic() - self._said_s >= _SAID_AGAIN_S:
            self._say()
        return result

    def say_rest(self) -> None:
        """Say how many spans are given up at the end."""
        with self._lock:
            self._left_out += self._waiting
            self._waiting = 0
        if self._left_out:
            self._say()

    def shutdown(self) -> None:
        """Give up what is not sent."""
        if not self._closed:
            self._closed = True
            self._inner.shutdown()

    def force_flush(self, timeout_millis: int = 30_000) -> bool:
        """Nothing is kept here."""
        return self._inner.force_flush(timeout_millis)

    def _say(self) -> None:
        self._said_s = time.monotonic()
        with self._lock:
            lost, self._left_out = self._left_out, 0
        reason = self._reason or 'there are more than the collector takes'
        self._log.warning(
            'traces: %s not sent to %s: %s; messages are not held up',
            count(lost, 'span'), self._endpoint, reason,
        )  # fmt: skip


def _cause(text: str) -> str:
    """What OpenTelemetry says of a request that has failed, without what is around it."""
    found = _ERRNO.search(text) or _STATUS.search(text)
    if found is None:
        return text or 'no answer'
    return f'{found[1]}: is a collector there that takes OTLP over HTTP?'


def _parent(context: TraceContext | None) -> trace.Span:
    if context is None:
        return trace.INVALID_SPAN
    state = trace.TraceState.from_header([context.state] if context.state else [])
    ids = int(context.trace_id, 16), int(context.span_id, 16)
    return trace.NonRecordingSpan(
        trace.SpanContext(*ids, is_remote=True, trace_flags=_SAMPLED, trace_state=state)
    )


def _resource(service: Service) -> Resource:
    told: Mapping[str, Any] = {
        'service.name': service.name,
        'service.version': __version__,
        'service.instance.id': str(uuid.uuid4()),
        'host.name': platform.node(),
        'ros2_kafka_bridge.name': service.bridge,
    }
    worker = {'ros2_kafka_bridge.worker': service.worker} if service.worker else {}
    return Resource.create({**told, **worker})
