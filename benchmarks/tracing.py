"""What tracing costs for each message, in microseconds on one core.

    python -m benchmarks.tracing

The lowest of several runs counts: whatever else the machine does makes a run longer only.
"""

import logging
import timeit
from collections.abc import Callable
from typing import Final

from opentelemetry.sdk.trace.export import SpanExporter, SpanExportResult

from ros2_kafka_bridge.endpoints import Message, headers_of
from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.route.flight.records import RecordEntry
from ros2_kafka_bridge.route.identity import Author
from ros2_kafka_bridge.route.labels import make_headers
from ros2_kafka_bridge.testing.memory import MemoryRecord
from ros2_kafka_bridge.tracing import export
from ros2_kafka_bridge.tracing.messages import with_traceparent
from ros2_kafka_bridge.tracing.records import SpansOfRecords
from ros2_kafka_bridge.tracing.span import Span

_SAMPLE: Final = 0.01
_CALLS: Final = 1000
_RUNS: Final = 50
_AUTHOR: Final = Author('/orders', 'bridge', 'orders')
_MESSAGE: Final = Message(b'x' * 100, bytes(range(16)), 42, 1_700_000_000_000_000_000)


class _Nowhere(SpanExporter):
    def export(self, spans: object) -> SpanExportResult:
        """Take them."""
        del spans
        return SpanExportResult.SUCCESS


def main() -> None:
    """Print a line for each part of the way."""
    plain = make_headers(_AUTHOR, 'std_msgs/msg/String', lambda _: 'RIHS01_ab')
    traced = with_traceparent(plain, _SAMPLE)
    without = MemoryRecord(b'x', header_list=plain(_MESSAGE))
    parent = ('traceparent', f'00-{"1" * 32}-{"2" * 16}-00'.encode())
    with_one = MemoryRecord(b'x', header_list=[*plain(_MESSAGE), parent])
    traces = SpansOfRecords('orders', {}, 0.0, lambda _: None)
    entry = RecordEntry(without, 0.0)

    def read(record: MemoryRecord) -> None:
        traces.begin(entry, record, headers_of(record))

    _say('headers of a message, without tracing', lambda: plain(_MESSAGE))
    _say('headers of a message, with tracing', lambda: traced(_MESSAGE))
    _say('headers of a record, without tracing', lambda: headers_of(with_one))
    _say('headers of a record without a traceparent, with tracing', lambda: read(without))
    _say('headers of a record with a traceparent, with tracing', lambda: read(with_one))
    attributes = {f'attribute.{number}': 'value' for number in range(14)}
    span = Span('process orders', 'consumer', None, None, 1, 2, attributes)
    log = RouteLog(logging.getLogger('tracing'), None)
    with export.open_exporter(export.Service('b', 'b', 0), 'http://127.0.0.1:1', log) as exporter:
        exporter._sender._inner = _Nowhere()  # noqa: SLF001 (what the thread of a route pays)
        _say('a span', lambda: exporter.end(span))


def _say(what: str, call: Callable[[], object]) -> None:
    took_s = min(timeit.repeat(call, number=_CALLS, repeat=_RUNS)) / _CALLS
    print(f'{1e6 * took_s:8.2f} µs  {what}')


if __name__ == '__main__':
    main()
