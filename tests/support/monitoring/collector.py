"""A collector of traces: OTLP over HTTP, in the process of the test."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import NamedTuple

from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import (
    ExportTraceServiceRequest,
    ExportTraceServiceResponse,
)
from opentelemetry.proto.common.v1.common_pb2 import AnyValue
from opentelemetry.proto.trace.v1 import trace_pb2
from support.processes.harness import eventually


class Seen(NamedTuple):
    """A span as it came.

    Args:
        name: Its name.
        kind: `consumer` or `producer`.
        trace_id: In hex.
        span_id: In hex.
        parent_id: In hex; empty where it begins the trace.
        state: Its `tracestate`.
        start_ns: Since 1970.
        end_ns: Since 1970.
        told: Its attributes.
        service: The attributes of the process that has sent it.
        failed: Whether its status is an error.
        text: The text of that.
    """

    name: str
    kind: str
    trace_id: str
    span_id: str
    parent_id: str
    state: str
    start_ns: int
    end_ns: int
    told: dict[str, str | int]
    service: dict[str, str | int]
    failed: bool
    text: str


class Collector:
    """What was sent to `endpoint`, in the order in which it came."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.endpoint = f'http://127.0.0.1:{port}/v1/traces'
        self.spans: list[Seen] = []
        self.requests: list[tuple[str, str]] = []  # path and content type

    def wait_for(self, count: int, timeout_s: float = 60.0) -> list[Seen]:
        """Wait until that many spans have come."""
        eventually(lambda: len(self.spans) >= count, timeout_s, lambda: f'{self.spans}')
        return self.spans


@contextmanager
def collector(port: int = 0) -> Iterator[Collector]:
    """Collect while the block runs."""
    server = ThreadingHTTPServer(('127.0.0.1', port), _Handler)
    server.daemon_threads = True
    made = Collector(server.server_address[1])
    server.collector = made  # type: ignore[attr-defined]  # where the handler finds it
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield made
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers['Content-Length']))
        made: Collector = self.server.collector  # type: ignore[attr-defined]
        made.spans += _spans(ExportTraceServiceRequest.FromString(body))
        made.requests.append((self.path, self.headers['Content-Type']))
        answer = ExportTraceServiceResponse().SerializeToString()
        self.send_response(200)
        self.send_header('Content-Type', 'application/x-protobuf')
        self.send_header('Content-Length', str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 (its name)
        """Say nothing."""


def _spans(request: ExportTraceServiceRequest) -> Iterator[Seen]:
    for resource in request.resource_spans:
        service = {pair.key: _value(pair.value) for pair in resource.resource.attributes}
        for scope in resource.scope_spans:
            for span in scope.spans:
                yield _seen(span, service)


def _seen(span: trace_pb2.Span, service: dict[str, str | int]) -> Seen:
    return Seen(
        name=span.name,
        kind=trace_pb2.Span.SpanKind.Name(span.kind).removeprefix('SPAN_KIND_').lower(),
        trace_id=span.trace_id.hex(),
        span_id=span.span_id.hex(),
        parent_id=span.parent_span_id.hex(),
        state=span.trace_state,
        start_ns=span.start_time_unix_nano,
        end_ns=span.end_time_unix_nano,
        told={pair.key: _value(pair.value) for pair in span.attributes},
        service=service,
        failed=span.status.code == trace_pb2.Status.STATUS_CODE_ERROR,
        text=span.status.message,
    )


def _value(value: AnyValue) -> str | int:
    found: str | int = getattr(value, value.WhichOneof('value') or 'string_value')
    return found
