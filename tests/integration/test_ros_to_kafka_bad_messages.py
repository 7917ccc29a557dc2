"""ROS -> Kafka as its users see it: what cannot be sent.

The guarantees are those of docs: 5 one bad record stops nothing, 6 counters balance.
"""

import time
from functools import partial
from typing import Any

import pytest
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AlterConfigOpType,
    ConfigEntry,
    ConfigResource,
    ResourceType,
)
from support.bridges.numbers_to_kafka import told
from support.bridges.routes import to_kafka, totals, values
from support.patience import patient
from support.processes.harness import Bench, eventually, headers
from support.ros.raw import identities, publish, text

LARGE = 9_003  # with header, length and NUL a multiple of 4: no padding is added to it
WAYS = {
    'max_message_bytes': 'more than max_message_bytes of the route (5000 bytes)',
    'message.max.bytes': 'more than message.max.bytes of the producer (5000 bytes)',
    'max.message.bytes': 'more than max.message.bytes of the topic',
    'batched': 'more than max.message.bytes of the topic',
}


def too_large(way: str, topic: str) -> dict[str, Any]:
    """A route that refuses 9,000 bytes in one of the ways there are."""
    if way == 'max_message_bytes':
        return to_kafka('/orders', topic, max_message_bytes=5000)
    made = to_kafka('/orders', topic)
    if way == 'message.max.bytes':
        made['to']['properties'] = {'message.max.bytes': 5000}
    if way == 'batched':  # the user's own batches are larger than the topic's limit
        made['to']['properties'] = {'batch.size': 500_000, 'linger.ms': 50}
    return made


def limit(bench: Bench, topic: str) -> None:
    """Make the largest message of a topic smaller."""
    entry = ConfigEntry('max.message.bytes', '5000', incremental_operation=AlterConfigOpType.SET)
    resource = ConfigResource(ResourceType.TOPIC, topic, incremental_configs=[entry])
    admin = bench.admin()
    admin.incremental_alter_configs([resource])[resource].result(patient(60))


@pytest.mark.parametrize('way', WAYS)
def test_a_message_that_is_too_large_is_a_dead_letter_and_stops_no_other_guarantee_5(
    bench: Bench, topic: str, way: str
) -> None:
    if way in {'max.message.bytes', 'batched'}:
        limit(bench, topic)
    small = [b'%d' % number for number in range(400)]
    sent = [text(data) for data in small]
    sent.insert(200, text(b'x' * LARGE))
    config = bench.config([too_large(way, topic)])
    with bench.drained(config) as bridge, publish(bench, '/orders', sent) as publisher:
        records = bench.records(topic, 400)
        [letter] = bench.records(f'{topic}.dead-letters', 1)
        gid = told(publisher, 'gid')
    assert values(records) == small
    assert letter.value() is None
    found = headers(letter)
    size = LARGE + 9 if way == 'max_message_bytes' else LARGE
    assert found['dead_letter.value_bytes'] == str(size)
    assert found['dead_letter.error'] == f'RecordTooLargeError: {size} bytes, {WAYS[way]}'
    assert found['dead_letter.source'] == '/orders'
    assert found['dead_letter.route'] == 'to_kafka'
    assert found['dead_letter.topic'] == topic
    assert abs(time.time_ns() - int(found['dead_letter.time_ns'])) < 60e9
    assert (found['ros.gid'], found['ros.seq']) == (gid, '201')
    assert '401 taken, 400 confirmed, 1 dead-lettered, 0 given up' in bridge.output()


def test_small_messages_in_a_batch_that_is_refused_are_no_dead_letters_guarantee_5(
    bench: Bench, topic: str
) -> None:
    """The limit is lowered while the bridge runs, so its batches are larger. They lose order."""
    small = [b'%03d' % number for number in range(400)]
    sent = [text(data) for data in (*small[:200], b'x' * LARGE, *small[200:])]
    made = to_kafka('/orders', topic)
    made['to']['properties'] = {'linger.ms': 5}
    with (
        bench.bridge(bench.config([made])) as bridge,
        publish(bench, '/orders', [text(b'first')]),
    ):
        bench.records(topic, 1)  # the bridge has asked for the limit before it sent this one
        limit(bench, topic)
        with publish(bench, '/orders', sent):
            records = bench.records(topic, 401)
            letters = bench.records(f'{topic}.dead-letters', 1)
            assert bridge.end() == 0
    assert sorted(values(records)) == [*small, b'first']
    assert [headers(letter)['ros.seq'] for letter in letters] == ['201']


def test_text_that_is_not_utf8_is_a_dead_letter_as_it_came_guarantee_5(
    bench: Bench, topic_name: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), text(b'after')]
    config = bench.config([to_kafka('/orders', topic_name)])
    with bench.drained(config), publish(bench, '/orders', sent):
        records = bench.records(topic_name, 2)
        [letter] = bench.records(f'{topic_name}.dead-letters', 1)
    assert values(records) == [b'before', b'after']
    value = letter.value()
    assert value is not None
    assert value[: len(sent[1])] == sent[1]
    found = headers(letter)
    assert found['dead_letter.error'] == 'EncodeError: data: not UTF-8 at byte 3: 0xe9'
    assert (found['dead_letter.source'], found['ros.seq']) == ('/orders', '2')


def test_what_was_refused_of_a_history_is_no_second_dead_letter_after_a_restart_guarantee_5(
    bench: Bench, topic: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), *(text(b'%d' % number) for number in range(2000))]
    latched = ('--durability', 'transient_local', '--readers', '0', '--rate', '50')
    config = bench.config([to_kafka('/orders', topic)])
    with publish(bench, '/orders', sent, *latched):
        for letters in (1, 0):
            reaches_more = partial(bench.reaches, topic, bench.end_offset(topic) + 9)
            with bench.drained(config) as bridge:
                eventually(reaches_more, 60, bridge.output)
            assert totals(bridge, 'to_kafka')['dead-lettered'] == letters
    assert bench.end_offset(f'{topic}.dead-letters') == 1
    identity = identities(bench.records(topic, bench.end_offset(topic)))
    assert [seq for _, seq in identity] == [1, *range(3, len(identity) + 2)]


def test_on_error_drop_counts_what_it_drops_and_goes_on_guarantee_6(
    bench: Bench, topic_name: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), text(b'x' * LARGE), text(b'after')]
    config = bench.config([to_kafka('/orders', topic_name, on_error='drop', max_message_bytes=99)])
    with bench.drained(config) as bridge, publish(bench, '/orders', sent):
        assert values(bench.records(topic_name, 2)) == [b'before', b'after']
    assert '4 taken, 2 confirmed, 0 dead-lettered, 0 given up, 2 dropped' in bridge.output()


def test_on_error_stop_ends_the_route_and_says_why_guarantee_5(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name, on_error='stop')])
    with bench.bridge(config) as bridge, publish(bench, '/orders', [text(b'caf\xe9')]):
        assert bridge.wait() == 1
    expected = 'to_kafka: failed: /orders -> {}: data: not UTF-8 at byte 3: 0xe9; stopped, as'
    assert expected.format(topic_name) in bridge.output()
    assert 'Traceback' not in bridge.output()
