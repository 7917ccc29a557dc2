"""Spans of records and messages, from what a pipeline tells to what a collector gets."""

import logging
import re
import socket
import time
from collections import deque
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from support.monitoring.collector import Collector, collector

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.endpoints import HeaderList, Message, Outgoing
from ros2_kafka_bridge.errors import ConfigError, DecodeError, EncodeError
from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.outside.extras import missing_extra
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.trace_context import parse
from ros2_kafka_bridge.testing.memory import MemoryRecord
from ros2_kafka_bridge.tracing import export
from ros2_kafka_bridge.tracing.export import MOST_WAITING, Exporter, Service, open_exporter
from ros2_kafka_bridge.tracing.messages import SpansOfMessages, with_traceparent
from ros2_kafka_bridge.tracing.records import NO_RECORD_TRACES, SpansOfRecords
from ros2_kafka_bridge.tracing.routes import Tracing
from ros2_kafka_bridge.tracing.span import Attributes, Span

TRACE, SPAN = '4bf92f3577b34da6a3ce929d0e0e4736', '00f067aa0ba902b7'
SAMPLED = ('traceparent', f'00-{TRACE}-{SPAN}-01'.encode())
NOT_SAMPLED = ('traceparent', f'00-{TRACE}-{SPAN}-00'.encode())
MESSAGE = Message(b'cdr', bytes(16), 3, 5)
SERVICE = Service('robots', 'warehouse-1', 2)
LOG = RouteLog(logging.getLogger('test'), None)


def _entry(offset: int = 0, headers: HeaderList | None = None) -> Any:
    """What is looked at of a record, or a message, in flight."""
    record = Outgoing('orders', None, b'value', headers or [])
    return SimpleNamespace(
        partition=1, offset=offset, taken_s=time.monotonic() - 1, outcome=None,
        record=record, gid=bytes(16), seq=3,
    )  # fmt: skip


class Records(NamedTuple):
    """Spans of records, and what begins them."""

    ended: list[Span]
    entries: deque[Any]
    traces: SpansOfRecords

    def take(self, *headers: tuple[str, str | bytes]) -> Any:
        entry = _entry(len(self.entries))
        self.entries.append(entry)
        self.traces.begin(entry, MemoryRecord(b'value'), [*headers])
        return entry


@pytest.fixture
def records() -> Records:
    return _records(0.0)


def _records(sample: float) -> Records:
    ended: list[Span] = []
    return Records(ended, deque(), SpansOfRecords('orders', {}, sample, ended.append))


# Kafka -> ROS


def test_the_span_of_a_sampled_record_is_the_child_of_what_wrote_it(records: Records) -> None:
    state = ('tracestate', b'vendor=1')
    records.take(SAMPLED, state, ('ros.seq', b'7')).outcome = Outcome.CONFIRMED
    records.traces.look()
    (span,) = records.ended
    assert span.parent is not None
    assert (span.parent.trace_id, span.parent.span_id) == (TRACE, SPAN)
    assert span.parent.state == 'vendor=1'
    assert (span.name, span.kind, span.error) == ('process orders', 'consumer', None)
    assert span.attributes == {
        'messaging.destination.partition.id': '1',
        'messaging.kafka.offset': 0,
        'messaging.message.body.size': 5,
        'ros.seq': '7',
        'ros2_kafka_bridge.outcome': 'confirmed',
    }
    assert 1e9 <= span.end_ns - span.start_ns < 60e9


def test_a_record_that_is_not_sampled_has_no_span_whatever_the_share() -> None:
    records = _records(1.0)
    records.take(NOT_SAMPLED).outcome = Outcome.CONFIRMED
    records.traces.look()
    assert not records.ended


@pytest.mark.parametrize(('sample', 'spans'), [(0.0, 0), (1.0, 20)])
def test_a_record_without_a_context_begins_a_trace_of_its_own(sample: float, spans: int) -> None:
    records = _records(sample)
    for number in range(20):
        header = () if number % 2 else (('traceparent', b'broken'),)
        records.take(*header).outcome = Outcome.CONFIRMED
    records.traces.look()
    assert [span.parent for span in records.ended] == [None] * spans


def test_the_span_of_a_dead_letter_is_an_error(records: Records) -> None:
    bad, good = records.take(SAMPLED), None
    records.traces.refused(bad, DecodeError('not UTF-8'))
    good = records.take(SAMPLED)
    good.outcome = Outcome.CONFIRMED
    records.traces.look()
    assert not records.ended
    bad.outcome = Outcome.DEAD_LETTERED
    records.traces.look()
    first, second = records.ended
    assert first.error == ('DecodeError', 'not UTF-8')
    assert second.error is None


def test_what_is_followed_has_a_bound() -> None:
    records = _records(1.0)
    for _ in range(10_500):
        records.take()
    for entry in records.entries:
        entry.outcome = Outcome.CONFIRMED
    records.traces.look()
    assert len(records.ended) == 10_000


def test_without_tracing_records_and_messages_take_the_way_that_they_took_before() -> None:
    off = Tracing()
    make_headers = with_traceparent(lambda _: [], 0.0)
    assert not NO_RECORD_TRACES.follow
    assert off.headers(make_headers) is make_headers


# ROS -> Kafka


def test_each_message_gets_a_trace_of_its_own_behind_its_other_headers() -> None:
    made = with_traceparent(lambda _: [('ros.topic', b'/orders')], 1.0)
    all_headers = [made(MESSAGE) for _ in range(1000)]
    assert {headers[0] for headers in all_headers} == {('ros.topic', b'/orders')}
    assert all([name for name, _ in h] == ['ros.topic', 'traceparent'] for h in all_headers)
    assert len({headers[-1] for headers in all_headers}) == 1000


def test_the_span_of_a_message_has_the_ids_of_its_header() -> None:
    ended: list[Span] = []
    traces = SpansOfMessages('orders', {'ros.topic': '/orders'}, ended.append)
    others = [_entry(headers=[NOT_SAMPLED]), _entry(headers=[('ros.seq', b'-01')]), _entry()]
    traces.confirmed([_entry(headers=[('ros.topic', b'x'), SAMPLED]), *others])
    (span,) = ended
    assert span.context == parse(SAMPLED[1])
    assert (span.name, span.kind, span.parent) == ('publish orders', 'producer', None)
    assert span.attributes['ros2_kafka_bridge.outcome'] == 'confirmed'
    assert span.attributes['ros.topic'] == '/orders'
    assert 1e9 <= span.end_ns - span.start_ns < 60e9


def test_a_message_that_became_a_dead_letter_or_was_dropped_says_why() -> None:
    ended: list[Span] = []
    traces = SpansOfMessages('orders', {}, ended.append)
    reason = ('dead_letter.error', 'RecordTooLargeError: 9 bytes: too many')
    traces.ended(_entry(headers=[SAMPLED, reason]), Outcome.DEAD_LETTERED)
    traces.ended(_entry(headers=[SAMPLED]), Outcome.DROPPED, EncodeError('no'))
    traces.ended(_entry(headers=[SAMPLED]), Outcome.DROPPED)
    traces.ended(_entry(headers=[NOT_SAMPLED, reason]), Outcome.DEAD_LETTERED)
    assert [span.error for span in ended] == [
        ('RecordTooLargeError', '9 bytes: too many'),
        ('EncodeError', 'no'),
        None,
    ]


# To the collector


@pytest.fixture
def there() -> Iterator[Collector]:
    with collector() as made:
        yield made


def _span(**more: object) -> Span:
    attributes: Attributes = {'messaging.system': 'kafka', 'messaging.kafka.offset': 7}
    span = Span('process orders', 'consumer', None, None, 1_000, 2_000, attributes)
    return span._replace(**more)  # type: ignore[arg-type]  # whatever a test sets


def test_a_collector_gets_spans_as_they_were_made(there: Collector) -> None:
    with open_exporter(SERVICE, there.endpoint, LOG) as exporter:
        parent = parse(SAMPLED[1])
        assert parent is not None
        exporter.end(_span(parent=parent._replace(state='vendor=1')))
        exporter.end(_span(kind='producer', context=parent))
        exporter.end(_span(error=('DecodeError', 'broken\x1b')))
    child, own, alone = there.spans
    assert (child.trace_id, child.parent_id, child.state) == (TRACE, SPAN, 'vendor=1')
    assert child.span_id != SPAN
    assert (own.trace_id, own.span_id, own.parent_id) == (TRACE, SPAN, '')
    assert (alone.parent_id, alone.failed) == ('', True)
    assert alone.trace_id not in {TRACE, '0' * 32}
    assert alone.text == 'DecodeError: broken\\x1b'
    assert alone.told['error.type'] == 'DecodeError'
    assert (child.name, child.kind, own.kind) == ('process orders', 'consumer', 'producer')
    assert (child.start_ns, child.end_ns, child.failed) == (1_000, 2_000, False)
    assert child.told == {'messaging.system': 'kafka', 'messaging.kafka.offset': 7}
    assert there.requests[0] == ('/v1/traces', 'application/x-protobuf')
    told = child.service
    assert (told['service.name'], told['service.version']) == ('robots', __version__)
    assert (told['ros2_kafka_bridge.name'], told['ros2_kafka_bridge.worker']) == ('warehouse-1', 2)
    assert re.fullmatch(r'[0-9a-f-]{36}', str(told['service.instance.id']))


def test_a_collector_that_is_away_holds_nobody_up_and_is_said_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, '_FLUSH_S', 0.2)
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))  # nobody listens there
        endpoint = f'http://127.0.0.1:{taken.getsockname()[1]}/v1/traces?api_key=sesame'
        with open_exporter(SERVICE, endpoint, LOG) as exporter:
            for _ in range(3 * MOST_WAITING):
                exporter.end(_span())
    LOG.close()
    said = [text for text in caplog.messages if text.startswith('traces: ')]
    told = [int(re.findall(r'traces: (\d+) spans? not sent to http', text)[0]) for text in said]
    assert sum(told) == 3 * MOST_WAITING, said
    assert len(said) <= 2, said
    assert all('messages are not held up' in text for text in said)
    assert not any('sesame' in text for text in said)


def test_a_collector_that_comes_back_gets_what_ends_then(there: Collector) -> None:
    with open_exporter(SERVICE, there.endpoint, LOG) as exporter:
        exporter.end(_span())
        there.wait_for(1)
        exporter.end(_span())
        assert isinstance(exporter, Exporter)
    assert len(there.spans) == 2


# The extra

CONFIG = """
name: warehouse-1
kafka: {bootstrap.servers: 'localhost:9092'}
routes: [{name: orders, from: {ros: /o, type: std_msgs/msg/String}, to: {kafka: o}, format: text}]
tracing: TRACING
"""


def _load(tracing: str, **environ: str) -> None:
    def missing(name: str) -> str | None:
        return 'install it' if name == 'tracing' else None

    loads(CONFIG.replace('TRACING', tracing), 'bridge.yaml', environ, check_format=missing)


def test_headers_alone_need_no_extra() -> None:
    _load('{sample: 1}')
    endpoint = {'OTEL_EXPORTER_OTLP_ENDPOINT': 'http://localhost:4318'}
    _load('{sample: 1}', OTEL_SDK_DISABLED='true', **endpoint)
    assert missing_extra('tracing') is None


@pytest.mark.parametrize(
    ('tracing', 'environ', 'where'),
    [
        ('{endpoint: "http://localhost:4318/v1/traces"}', {}, 'tracing.endpoint: '),
        ('{}', {'OTEL_EXPORTER_OTLP_ENDPOINT': 'http://localhost:4318'}, 'tracing: '),
        ('{}', {'OTEL_EXPORTER_OTLP_TRACES_ENDPOINT': 'http://localhost:4318'}, 'tracing: '),
    ],
)
def test_spans_without_their_extra_are_refused_at_once(
    tracing: str, environ: dict[str, str], where: str
) -> None:
    with pytest.raises(ConfigError, match=f'bridge.yaml:5: {where}install it'):
        _load(tracing, **environ)
