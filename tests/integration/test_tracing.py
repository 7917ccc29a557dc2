"""Traces of a bridge that runs, with a real Kafka, DDS and collector."""

from pathlib import Path

from support.bridges.routes import to_ros
from support.bridges.words import ROS_TOPIC, wait_for, wait_for_commit
from support.monitoring.collector import collector
from support.processes.harness import Bench, headers

TRACE = '4bf92f3577b34da6a3ce929d0e0e4736'


def sampled(number: int, flags: str = '01') -> tuple[str, bytes]:
    return ('traceparent', f'00-{TRACE}-{number:016x}-{flags}'.encode())


def test_the_trace_of_a_producer_goes_on_in_the_bridge(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """A record that is not sampled has no span, one that cannot be delivered an error."""
    records = [(b'first', 1, '01'), (b'second', 2, '00'), (b'caf\xe9', 3, '01')]
    for value, number, flags in records:
        state = [('tracestate', b'vendor=7')]
        bench.produce(topic, [value], headers=[sampled(number, flags), *state])
    with collector() as there:
        tracing = {'sample': 1, 'endpoint': there.endpoint, 'service': 'robots'}
        config = bench.config([to_ros(topic, ROS_TOPIC)], tracing=tracing)
        with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
            wait_for(arrived, ['first', 'second'], bridge)
            wait_for_commit(bench, topic, 3, bridge)
            first, bad = sorted(there.wait_for(2), key=lambda span: span.parent_id)
    assert len(there.spans) == 2
    assert (first.trace_id, first.parent_id, first.state) == (TRACE, f'{1:016x}', 'vendor=7')
    assert (first.name, first.kind, first.failed) == (f'process {topic}', 'consumer', False)
    assert first.service['service.name'] == 'robots'
    expected: dict[str, str | int] = {
        'messaging.system': 'kafka',
        'messaging.operation.name': 'process',
        'messaging.operation.type': 'process',
        'messaging.destination.name': topic,
        'messaging.destination.partition.id': '0',
        'messaging.kafka.offset': 0,
        'messaging.consumer.group.name': bench.group,
        'messaging.client.id': bench.name,
        'messaging.message.body.size': 5,
        'ros.topic': ROS_TOPIC,
        'ros.type': 'std_msgs/msg/String',
        'ros2_kafka_bridge.route': 'to_ros',
        'ros2_kafka_bridge.outcome': 'confirmed',
    }
    assert first.told == expected
    assert 0 < first.end_ns - first.start_ns < 60e9
    assert (bad.trace_id, bad.parent_id, bad.failed) == (TRACE, f'{3:016x}', True)
    assert bad.text == 'DecodeError: not UTF-8 at byte 3: 0xe9'
    assert bad.told['ros2_kafka_bridge.outcome'] == 'dead_lettered'
    (letter,) = bench.records(f'{topic}.dead-letters', 1)
    assert headers(letter)['traceparent'] == sampled(3)[1].decode()
