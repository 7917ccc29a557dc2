"""Traces and logs of a bridge that runs, with a real Kafka, DDS and collector."""

import json
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import lines, to_kafka, to_ros
from support.bridges.words import ROS_TOPIC, wait_for, wait_for_commit
from support.monitoring.collector import Collector, Seen, collector
from support.processes.harness import Bench, Process, eventually, headers

from ros2_kafka_bridge.route.trace_context import parse

TRACE, SPAN = '4bf92f3577b34da6a3ce929d0e0e4736', '00f067aa0ba902b7'
Unique = Callable[[str], str]


@pytest.fixture
def there() -> Iterator[Collector]:
    with collector() as made:
        yield made


def sampled(number: int = 1, flags: str = '01') -> list[tuple[str, bytes]]:
    return [('traceparent', f'00-{TRACE}-{number:016x}-{flags}'.encode())]


def said(bridge: Process, **fields: Any) -> list[dict[str, Any]]:
    """The lines of JSON with these fields."""
    # DDS writes to the same place, in its own way: shared memory that a killed process has left.
    found = [json.loads(line) for line in lines(bridge.log) if 'RTPS_TRANSPORT' not in line]
    return [line for line in found if fields.items() <= line.items()]


def test_ros_to_kafka_to_ros_through_two_bridges_is_one_trace_for_each_message(
    bench: Bench, unique: Unique, arrived: Path, there: Collector
) -> None:
    topic, count = unique('topic'), 50
    bench.create_topic(topic)
    tracing = {'sample': 1, 'endpoint': there.endpoint}
    there_way = bench.config([to_kafka('/words', topic)], name='one', tracing=tracing)
    back = bench.config([to_ros(topic, '/words_again')], name='two', tracing=tracing)
    with (
        bench.subscriber('/words_again', arrived),
        bench.bridge(there_way) as one,
        bench.bridge(back) as two,
        bench.publisher('/words', '--count', str(count)) as publisher,
    ):
        publisher.wait_for('published', 60)
        wait_for(arrived, [str(number) for number in range(count)], two)
        spans = there.wait_for(2 * count)
        assert (one.end(40), two.end(40)) == (0, 0)
    sent = {span.span_id: span for span in spans if span.kind == 'producer'}
    got = {span.parent_id: span for span in spans if span.kind == 'consumer'}
    assert len(sent) == len(got) == count
    assert len({span.trace_id for span in spans}) == count
    records = bench.records(topic, count)
    for record in records:
        context = parse(headers(record)['traceparent'])
        assert context is not None
        first, second = sent[context.span_id], got[context.span_id]
        assert first.trace_id == second.trace_id == context.trace_id
        assert first.parent_id == ''
        assert first.start_ns <= second.end_ns
        assert (first.service['service.name'], second.service['service.name']) == ('one', 'two')
        assert str(first.told['ros.seq']) == second.told['ros.seq'] == headers(record)['ros.seq']
    assert {span.name for span in sent.values()} == {f'publish {topic}'}


@pytest.mark.parametrize('sample', [0, 1])
def test_headers_need_no_collector_and_say_whether_a_trace_is_sampled(
    bench: Bench, topic_name: str, sample: int
) -> None:
    config = bench.config([to_kafka('/words', topic_name)], tracing={'sample': sample})
    with bench.drained(config), bench.publisher('/words', '--count', '100') as publisher:
        publisher.wait_for('published', 60)
        records = bench.records(topic_name, 100)
    found = [parse(headers(record)['traceparent']) for record in records]
    assert {context.sampled for context in found if context} == {bool(sample)}
    assert len({context.trace_id for context in found if context}) == 100


def test_without_tracing_no_header_is_written(bench: Bench, topic_name: str) -> None:
    config = bench.config([to_kafka('/words', topic_name)])
    with bench.drained(config), bench.publisher('/words', '--count', '10') as publisher:
        publisher.wait_for('published', 60)
        records = bench.records(topic_name, 10)
    assert not any('traceparent' in headers(record) for record in records)


def test_a_share_of_zero_makes_no_span(bench: Bench, topic_name: str, there: Collector) -> None:
    tracing = {'sample': 0, 'endpoint': there.endpoint}
    config = bench.config([to_kafka('/words', topic_name)], tracing=tracing)
    with bench.drained(config), bench.publisher('/words', '--count', '50') as publisher:
        publisher.wait_for('published', 60)
        bench.records(topic_name, 50)
    assert there.spans == []


def test_a_stop_sends_the_spans_that_wait(bench: Bench, topic_name: str, there: Collector) -> None:
    """Named by the environment, as every program with OpenTelemetry is told it."""
    config = bench.config([to_kafka('/words', topic_name)], tracing={'sample': 1})
    collect_at = f'http://127.0.0.1:{there.port}'
    with (
        bench.drained(config, OTEL_EXPORTER_OTLP_ENDPOINT=collect_at),
        bench.publisher('/words', '--count', '30') as publisher,
    ):
        publisher.wait_for('published', 60)
        bench.records(topic_name, 30)
    assert len(there.spans) == 30


def test_each_worker_sends_the_spans_of_its_routes(
    bench: Bench, unique: Unique, there: Collector
) -> None:
    first, second = unique('first'), unique('second')
    routes = [to_kafka('/one', first, name='a'), to_kafka('/two', second, name='b')]
    tracing = {'sample': 1, 'endpoint': there.endpoint}
    config = bench.config(routes, workers=2, tracing=tracing)
    with (
        bench.drained(config),
        bench.publisher('/one', '--count', '5') as one,
        bench.publisher('/two', '--count', '5') as two,
    ):
        one.wait_for('published', 60)
        two.wait_for('published', 60)
        spans = there.wait_for(10)
    told = {(s.told['ros2_kafka_bridge.route'], s.service['service.instance.id']) for s in spans}
    assert sorted(route for route, _ in told) == ['a', 'b']
    assert len({instance for _, instance in told}) == 2


def test_a_collector_that_is_away_is_said_and_holds_nothing_up(
    bench: Bench, unique: Unique, arrived: Path
) -> None:
    given, taken, count = unique('given'), unique('taken'), 5000
    bench.create_topic(given)
    bench.produce(given, [str(number).encode() for number in range(count)])
    routes = [to_kafka('/said', taken), to_ros(given, ROS_TOPIC)]
    with socket.socket() as nobody:
        nobody.bind(('127.0.0.1', 0))  # and does not listen
        endpoint = f'http://127.0.0.1:{nobody.getsockname()[1]}/v1/traces'
        tracing = {'sample': 1, 'endpoint': endpoint}
        config = bench.config(routes, kafka=bench.patient_kafka, tracing=tracing)
        with (
            bench.subscriber(ROS_TOPIC, arrived),
            bench.drained(config) as bridge,
            bench.publisher('/said', '--count', str(count)) as publisher,
        ):
            publisher.wait_for('published', 60)
            assert len(bench.records(taken, count)) == count
            wait_for(arrived, [str(number) for number in range(count)], bridge, 60)
    output = bridge.output()
    assert f'not sent to {endpoint}: Connection refused' in output
    assert 1 <= output.count('messages are not held up') <= 3
    assert 'Traceback' not in output


def test_the_span_of_a_message_that_waited_on_disk_has_the_time_of_its_waiting(
    own_bench: Bench, own_kafka: Any, own_topic: str, there: Collector
) -> None:
    """Also where it was another life of the bridge that took it."""
    spool = {'path': str(own_bench.place / 'spool')}
    config = own_bench.config(
        [to_kafka('/words', own_topic, spool=spool)],
        tracing={'sample': 1, 'endpoint': there.endpoint},
    )
    with own_bench.bridge(config) as bridge:
        with own_bench.publisher('/words', '--count', '1') as publisher:
            publisher.wait_for('published', 60)
            there.wait_for(1)
        own_kafka.stop()
        with own_bench.publisher('/words', '--count', '20') as publisher:
            publisher.wait_for('published', 60)
            bridge.wait_for('new messages go to the spool')
            assert bridge.end(60) == 0
    assert len(there.spans) == 1
    own_kafka.start()
    with own_bench.drained(config) as bridge:
        spans = there.wait_for(21)
    records = own_bench.records(own_topic, 21)
    contexts = [parse(headers(record)['traceparent']) for record in records]
    by_id = {span.span_id: span for span in spans}
    waited = [by_id[context.span_id] for context in contexts if context][1:]
    began_again = min(span.end_ns for span in waited)
    assert all(span.start_ns < began_again for span in waited)
    assert _longest_s(waited) > 1


def _longest_s(spans: list[Seen]) -> float:
    return max(span.end_ns - span.start_ns for span in spans) / 1e9


# Logs


def test_a_line_about_a_bad_record_says_in_fields_which_one_it_is(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """One of many, and summed: also what is another error, and the rest at the end."""
    label = [('ros.gid', b'00ff' * 8), ('ros.seq', b'9')]
    bench.produce(topic, [b'caf\xe9'] * 100, headers=[*sampled(), *label])
    bench.produce(topic, [None, b'last'])
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.run(config, '--log-format', 'json') as bridge,
    ):
        wait_for(arrived, ['last'], bridge)
        wait_for_commit(bench, topic, 102, bridge)
        assert bridge.end(40) == 0
    found = said(bridge, topic=topic, error='DecodeError')
    assert all('pid' in line and line['thread'] == 'to_ros' for line in found[:-1])
    *alone, null, rest = found
    assert [line['offset'] for line in alone] == list(range(5))
    assert {line['trace_id'] for line in alone} == {TRACE}
    assert {(line['route'], line['partition'], line['gid'], line['seq']) for line in alone} == {
        ('to_ros', 0, '00ff' * 8, 9)
    }
    assert (null['offset'], null.get('trace_id')) == (100, None)
    assert (rest['offset'], rest['times']) == (99, 95)
    assert '(95 times more)' in rest['message']


def test_a_line_about_a_message_that_cannot_be_written_names_its_publisher(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/words', topic_name, max_message_bytes=200)])
    with (
        bench.run(config, '--log-format', 'json') as bridge,
        bench.publisher('/words', '--count', '1', '--size', '500') as publisher,
    ):
        publisher.wait_for('published', 60)
        eventually(lambda: bool(said(bridge, error='RecordTooLargeError')), 40, bridge.output)
        assert bridge.end(40) == 0
    (line,) = said(bridge, error='RecordTooLargeError')
    assert (line['topic'], line['ros_topic'], line['seq']) == (topic_name, '/words', 1)
    assert len(line['gid']) == 32


def test_a_record_that_ends_its_route_is_named_in_the_line_that_says_so(
    bench: Bench, topic: str, arrived: Path
) -> None:
    bench.produce(topic, [b'first'])
    bench.produce(topic, [b'caf\xe9'], headers=sampled())
    config = bench.config([to_ros(topic, ROS_TOPIC, on_error='stop')])
    with (
        bench.subscriber(ROS_TOPIC, arrived),
        bench.run(config, '--log-format', 'json') as bridge,
    ):
        assert bridge.wait(60) == 1
    (line,) = said(bridge, error='DecodeError')
    assert line['message'].startswith('failed: ')
    assert (line['topic'], line['offset'], line['trace_id']) == (topic, 1, TRACE)


def test_the_text_of_a_line_names_the_trace(bench: Bench, topic: str, arrived: Path) -> None:
    bench.produce(topic, [b'caf\xe9'], headers=sampled())
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        bridge.wait_for('not UTF-8', 60)
    assert f'{topic}[0]@0: not UTF-8 at byte 3: 0xe9 (trace {TRACE})' in bridge.output()
