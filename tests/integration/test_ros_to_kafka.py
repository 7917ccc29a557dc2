"""ROS -> Kafka as its users see it: headers, keys, publishers of every kind, what cannot be sent.

The guarantees are those of docs: 2 at least once without duplicates, 3 order, 4 full means wait,
5 one bad record stops nothing, 6 counters balance.
"""

import re
import signal
import struct
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Message
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AlterConfigOpType,
    ConfigEntry,
    ConfigResource,
    ResourceType,
)
from harness import Bench, Process, eventually, headers, to_kafka, to_ros, totals, values
from patience import patient

from ros2_kafka_bridge.ros.types import load_type

STRING = 'std_msgs/msg/String'
Unique = Callable[[str], str]


def text(data: bytes, order: str = '<') -> bytes:
    """The CDR bytes of a std_msgs/String."""
    header = b'\0\1\0\0' if order == '<' else b'\0\0\0\0'
    return header + struct.pack(f'{order}I', len(data) + 1) + data + b'\0'


def odometry(order: str = '<', child: bytes = b'base_link') -> bytes:
    """The CDR bytes of a nav_msgs/Odometry with a different number in each field."""
    header = b'\0\1\0\0' if order == '<' else b'\0\0\0\0'
    size = len(child) + 1
    names = struct.pack(f'{order}iII4sI{size}s', 7, 8, 4, b'map\0', size, child)
    numbers = struct.pack(f'{order}85d', *(number / 7 for number in range(85)))
    return header + names + bytes(-len(names) % 8) + numbers


def pose(frame: str) -> bytes:
    """The CDR bytes of a geometry_msgs/PoseStamped."""
    name = frame.encode() + b'\0'
    front = struct.pack('<iII', 1, 2, len(name)) + name
    return b'\0\1\0\0' + front + bytes(-len(front) % 8) + struct.pack('<7d', *range(7))


def publish(
    bench: Bench,
    topic: str,
    messages: Sequence[bytes],
    *options: str,
    message_type: str = STRING,
) -> Process:
    """Start a node that publishes CDR bytes."""
    file = bench.place / f'{time.monotonic_ns()}.hex'
    file.write_text('\n'.join(message.hex() for message in messages))
    return bench.script('ros_raw_publisher.py', topic, message_type, str(file), *options)


def route(
    ros: str, kafka: str, message_type: str | None, name: str, **sink: Any
) -> dict[str, Any]:
    """A route ROS -> Kafka as cdr."""
    source = {'ros': ros} if message_type is None else {'ros': ros, 'type': message_type}
    return {'name': name, 'from': source, 'to': {'kafka': kafka, **sink}, 'format': 'cdr'}


def identities(records: Sequence[Message]) -> list[tuple[str, int]]:
    """Publisher and number of each record."""
    found = [headers(record) for record in records]
    return [(header['ros.gid'], int(header['ros.seq'])) for header in found]


def of(prefix: bytes, records: Sequence[Message]) -> list[bytes]:
    """The values that begin so, in the order of the topic."""
    return [value for value in values(list(records)) if value.startswith(prefix)]


def last(bench: Bench, topic: str) -> bytes:
    """The last value just now of a topic that something has come to."""
    return values(bench.records(topic, bench.end_offset(topic)))[-1]


def numbered(prefix: str, count: int) -> list[bytes]:
    """What tests/peers/ros_publisher.py publishes."""
    return [f'{prefix}{number}'.encode() for number in range(count)]


# Headers and keys


def test_headers_name_topic_type_publisher_number_time_and_origin_guarantee_2(
    bench: Bench, topic_name: str
) -> None:
    before_ns = time.time_ns()
    sent = [text(b'%d' % number) for number in range(100)]
    config = bench.config([to_kafka('/orders', topic_name)])
    with bench.bridge(config) as bridge, publish(bench, '/orders', sent) as publisher:
        records = bench.records(topic_name, 100)
        gid = publisher.output().split()[1]
        assert bridge.end() == 0
    assert values(records) == [b'%d' % number for number in range(100)]
    found = [headers(record) for record in records]
    assert [header.pop('ros.seq') for header in found] == [str(n) for n in range(1, 101)]
    times = [int(header.pop('ros.source_time_ns')) for header in found]
    assert times == sorted(times)
    assert before_ns < times[0] <= times[-1] < time.time_ns()
    assert found == 100 * [
        {
            'ros.topic': '/orders',
            'ros.type': STRING,
            'ros.type_hash': load_type(STRING).type_hash,
            'ros.gid': gid,
            'bridge.origin': bench.name,
        }
    ]
    assert {record.key() for record in records} == {b'/orders'}


def test_a_key_is_made_of_the_publisher_or_of_fields_of_the_message(
    bench: Bench, unique: Unique
) -> None:
    by_gid, by_data, by_frame = unique('gid'), unique('data'), unique('frame')
    stamped = 'geometry_msgs/msg/PoseStamped'
    config = bench.config(
        [
            route('/orders', by_gid, STRING, 'by_gid', key='from {ros.gid}'),
            route('/orders', by_data, STRING, 'by_data', key='{ros.topic}/{message.data}'),
            route('/poses', by_frame, stamped, 'by_frame', key='{message.header.frame_id}'),
        ]
    )
    poses = [pose('map'), pose('odom')]
    with (
        bench.bridge(config) as bridge,
        publish(bench, '/orders', [text(b'a'), text(b'b')], '--readers', '2') as publisher,
        publish(bench, '/poses', poses, message_type=stamped),
    ):
        of_gid, of_data = bench.records(by_gid, 2), bench.records(by_data, 2)
        of_frame = bench.records(by_frame, 2)
        gid = publisher.output().split()[1]
        assert bridge.end() == 0
    assert [record.key() for record in of_gid] == 2 * [f'from {gid}'.encode()]
    assert [record.key() for record in of_data] == [b'/orders/a', b'/orders/b']
    assert [record.key() for record in of_frame] == [b'map', b'odom']
    assert values(of_frame) == poses


def test_a_key_of_a_field_that_the_type_lacks_fails_the_route_and_names_it(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    config.write_text(
        config.read_text().replace(
            f'kafka: {topic_name}', f'kafka: {topic_name}, key: "{{message.x}}"'
        )
    )
    with bench.bridge(config) as bridge:
        bridge.wait_for('std_msgs/msg/String has no number or text at x')
        bridge.end()


# Publishers of every kind


def test_a_best_effort_publisher_is_followed_in_order_guarantee_3(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--reliability', 'best_effort', '--count', '300', '--rate', '300')
    with bench.bridge(config) as bridge, bench.publisher('/orders', *options):
        records = bench.records(topic_name, 300)
        bridge.wait_for('subscribes to /orders (best_effort, volatile)')
        assert bridge.end() == 0
    assert values(records) == numbered('', 300)


def test_the_whole_history_of_a_transient_local_publisher_arrives_guarantee_8(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--durability', 'transient_local', '--count', '3000', '--readers', '0')
    with bench.publisher('/orders', *options) as publisher:
        publisher.wait_for('published 3000')
        with bench.bridge(config) as bridge:
            records = bench.records(topic_name, 3000)
            assert bridge.end() == 0
    assert values(records) == numbered('', 3000)
    assert [seq for _, seq in identities(records)] == list(range(1, 3001))


def reliable_ones(bench: Bench, topic: str) -> int:
    records = bench.records(topic, bench.end_offset(topic))
    return len(of(b'b', records)) + len(of(b'c', records))


def test_late_publishers_of_other_qos_are_followed_without_loss_or_duplicates_guarantee_2(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    slow = ('--rate', '200', '--count', '600', '--reliability', 'best_effort', '--prefix', 'a')
    # Two subscriptions match it: the best-effort one and its own.
    twice = ('--count', '1000', '--prefix', 'b', '--readers', '2')
    latched = ('--count', '1000', '--prefix', 'c', '--readers', '0')
    with bench.bridge(config) as bridge, bench.publisher('/orders', *slow) as first:
        bench.records(topic_name, 1)
        with (
            bench.publisher('/orders', *twice) as second,
            bench.publisher('/orders', *latched, '--durability', 'transient_local') as third,
        ):
            for publisher in (second, third, first):
                publisher.wait_for('published')
            # What a reader has not got yet goes with it at a stop, so all must have arrived.
            eventually(lambda: reliable_ones(bench, topic_name) == 2000, 60, bridge.output)
            assert bridge.end() == 0
            records = bench.records(topic_name, totals(bridge, 'to_kafka')['confirmed'])
    assert of(b'b', records) == numbered('b', 1000)
    assert of(b'c', records) == numbered('c', 1000)
    best_effort = [int(value[1:]) for value in of(b'a', records)]
    assert best_effort == sorted(set(best_effort))
    assert len(set(identities(records))) == len(records)


def test_order_is_kept_for_each_of_two_publishers_guarantee_3(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    with (
        bench.bridge(config) as bridge,
        bench.publisher('/orders', '--count', '3000', '--prefix', 'a'),
        bench.publisher('/orders', '--count', '3000', '--prefix', 'b'),
    ):
        records = bench.records(topic_name, 6000)
        assert bridge.end() == 0
    assert len(records) == 6000
    assert of(b'a', records) == numbered('a', 3000)
    assert of(b'b', records) == numbered('b', 3000)
    assert len({gid for gid, _ in identities(records)}) == 2


def test_what_a_keep_last_publisher_overwrites_is_counted_and_said_guarantee_2(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    until = tmp_path / 'until'
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--depth', '1', '--rate', '2000', '--until', str(until))
    with bench.bridge(config) as bridge, bench.publisher('/orders', *options) as publisher:
        bench.records(topic_name, 1)
        bridge.send(signal.SIGSTOP)
        time.sleep(patient(4))  # much more is published than what DDS holds for the bridge
        until.touch()
        publisher.wait_for('published ', 60)
        bridge.send(signal.SIGCONT)
        count = int(publisher.output().split()[1])
        eventually(lambda: last(bench, topic_name) == b'%d' % (count - 1), 60)
        assert bridge.end() == 0
        records = bench.records(topic_name, totals(bridge, 'to_kafka')['confirmed'])
    seqs = [seq for _, seq in identities(records)]
    assert seqs == sorted(set(seqs))
    assert 'messages of /orders were lost before the bridge' in bridge.output()
    found = totals(bridge, 'to_kafka')
    assert found['lost before the bridge'] == count - len(seqs)
    assert found['taken'] == found['confirmed'] == len(seqs)


# Types


def test_two_types_on_a_topic_fail_that_route_only_until_one_leaves_guarantee_5(
    bench: Bench, unique: Unique
) -> None:
    mixed, other = unique('mixed'), unique('other')
    source = {'from': {'ros': '/mixed'}}
    routes = [to_kafka('', mixed, 'mixed') | source, to_kafka('/other', other, 'other')]
    latched = ('--durability', 'transient_local', '--readers', '0')
    number = b'\0\1\0\0' + struct.pack('<i', 7)
    with (
        bench.bridge(bench.config(routes)) as bridge,
        publish(bench, '/mixed', [number], *latched, message_type='std_msgs/msg/Int32') as leaving,
    ):
        bridge.wait_for('mixed: failed: text carries std_msgs/msg/String, not std_msgs/msg/Int32')
        with (
            publish(bench, '/mixed', [text(b'x')], *latched),
            publish(bench, '/other', [text(b'y')]),
        ):
            bridge.wait_for(
                'mixed: failed: /mixed has two types, std_msgs/msg/Int32 and std_msgs/msg/String'
            )
            assert leaving.end() == 0
            assert values(bench.records(other, 1)) == [b'y']
            assert values(bench.records(mixed, 1)) == [b'x']
            assert bridge.end() == 0


def test_a_route_with_a_type_takes_it_and_names_the_stranger(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([route('/mixed', topic_name, STRING, 'mixed')])
    numbers = [b'\0\1\0\0' + struct.pack('<i', 7)]
    with (
        publish(bench, '/mixed', numbers, '--readers', '0', message_type='std_msgs/msg/Int32'),
        bench.bridge(config) as bridge,
        publish(bench, '/mixed', [text(b'x'), text(b'y')]),
    ):
        assert values(bench.records(topic_name, 2)) == [text(b'x'), text(b'y')]
        bridge.wait_for('publishes std_msgs/msg/Int32 on /mixed, this route reads std_msgs/msg/S')
        assert bridge.end() == 0
    assert bridge.output().count('publishes std_msgs/msg/Int32') == 1


def test_a_route_without_a_type_waits_for_the_one_that_the_graph_shows(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([route('/odom', topic_name, None, 'odometry')])
    with bench.bridge(config) as bridge:
        bridge.wait_for('runs 1 route on')
        with publish(bench, '/odom', [odometry()], message_type='nav_msgs/msg/Odometry'):
            [record] = bench.records(topic_name, 1)
            assert bridge.end() == 0
    assert headers(record)['ros.type'] == 'nav_msgs/msg/Odometry'
    assert record.value() == odometry()


def test_a_route_that_still_waits_for_its_type_stops_at_once_when_asked(
    bench: Bench, topic_name: str
) -> None:
    with bench.bridge(bench.config([route('/odom', topic_name, None, 'odometry')])) as bridge:
        bridge.wait_for('runs 1 route on')
        assert bridge.end() == 0


# What cannot be sent

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
    bench: Bench, topic_name: str, way: str
) -> None:
    bench.create_topic(topic_name)
    if way in {'max.message.bytes', 'batched'}:
        limit(bench, topic_name)
    small = [b'%d' % number for number in range(400)]
    sent = [text(data) for data in small]
    sent.insert(200, text(b'x' * LARGE))
    config = bench.config([too_large(way, topic_name)])
    with bench.bridge(config) as bridge, publish(bench, '/orders', sent) as publisher:
        records = bench.records(topic_name, 400)
        [letter] = bench.records(f'{topic_name}.dead-letters', 1)
        gid = publisher.output().split()[1]
        assert bridge.end() == 0
    assert values(records) == small
    assert letter.value() is None
    found = headers(letter)
    size = LARGE + 9 if way == 'max_message_bytes' else LARGE
    assert found['dead_letter.value_bytes'] == str(size)
    assert found['dead_letter.error'] == f'RecordTooLargeError: {size} bytes, {WAYS[way]}'
    assert found['dead_letter.source'] == '/orders'
    assert found['dead_letter.route'] == 'to_kafka'
    assert found['dead_letter.topic'] == topic_name
    assert abs(time.time_ns() - int(found['dead_letter.time_ns'])) < 60e9
    assert (found['ros.gid'], found['ros.seq']) == (gid, '201')
    assert '401 taken, 400 confirmed, 1 dead-lettered, 0 given up' in bridge.output()


def test_small_messages_in_a_batch_that_is_refused_are_no_dead_letters_guarantee_5(
    bench: Bench, topic_name: str
) -> None:
    """The limit is lowered while the bridge runs, so its batches are larger. They lose order."""
    bench.create_topic(topic_name)
    small = [b'%03d' % number for number in range(400)]
    sent = [text(data) for data in (*small[:200], b'x' * LARGE, *small[200:])]
    made = to_kafka('/orders', topic_name)
    made['to']['properties'] = {'linger.ms': 5}
    with (
        bench.bridge(bench.config([made])) as bridge,
        publish(bench, '/orders', [text(b'first')]),
    ):
        bench.records(topic_name, 1)  # the bridge has asked for the limit before it sent this one
        limit(bench, topic_name)
        with publish(bench, '/orders', sent):
            records = bench.records(topic_name, 401)
            letters = bench.records(f'{topic_name}.dead-letters', 1)
            assert bridge.end() == 0
    assert sorted(values(records)) == [*small, b'first']
    assert [headers(letter)['ros.seq'] for letter in letters] == ['201']


def test_text_that_is_not_utf8_is_a_dead_letter_as_it_came_guarantee_5(
    bench: Bench, topic_name: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), text(b'after')]
    config = bench.config([to_kafka('/orders', topic_name)])
    with bench.bridge(config) as bridge, publish(bench, '/orders', sent):
        records = bench.records(topic_name, 2)
        [letter] = bench.records(f'{topic_name}.dead-letters', 1)
        assert bridge.end() == 0
    assert values(records) == [b'before', b'after']
    value = letter.value()
    assert value is not None
    assert value[: len(sent[1])] == sent[1]
    found = headers(letter)
    assert found['dead_letter.error'] == 'EncodeError: data: not UTF-8 at byte 3: 0xe9'
    assert (found['dead_letter.source'], found['ros.seq']) == ('/orders', '2')


def test_what_was_refused_of_a_history_is_no_second_dead_letter_after_a_restart_guarantee_5(
    bench: Bench, topic_name: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), *(text(b'%d' % number) for number in range(2000))]
    latched = ('--durability', 'transient_local', '--readers', '0', '--period', '0.02')
    config = bench.config([to_kafka('/orders', topic_name)])
    bench.create_topic(topic_name)
    with publish(bench, '/orders', sent, *latched):
        for letters in (1, 0):
            reaches_more = partial(bench.reaches, topic_name, bench.end_offset(topic_name) + 9)
            with bench.bridge(config) as bridge:
                eventually(reaches_more, 60, bridge.output)
                assert bridge.end() == 0
            assert totals(bridge, 'to_kafka')['dead-lettered'] == letters
    assert bench.end_offset(f'{topic_name}.dead-letters') == 1
    identity = identities(bench.records(topic_name, bench.end_offset(topic_name)))
    assert [seq for _, seq in identity] == [1, *range(3, len(identity) + 2)]


def test_on_error_drop_counts_what_it_drops_and_goes_on_guarantee_6(
    bench: Bench, topic_name: str
) -> None:
    sent = [text(b'before'), text(b'caf\xe9'), text(b'x' * LARGE), text(b'after')]
    config = bench.config([to_kafka('/orders', topic_name, on_error='drop', max_message_bytes=99)])
    with bench.bridge(config) as bridge, publish(bench, '/orders', sent):
        assert values(bench.records(topic_name, 2)) == [b'before', b'after']
        assert bridge.end() == 0
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


# Bytes


def test_cdr_is_what_a_typed_publisher_sends_byte_for_byte(bench: Bench, unique: Unique) -> None:
    from rclpy.serialization import deserialize_message, serialize_message  # noqa: PLC0415

    strings, odometries = unique('strings'), unique('odometries')
    kind = 'nav_msgs/msg/Odometry'
    config = bench.config(
        [
            route('/strings', strings, STRING, 'strings'),
            route('/odometries', odometries, kind, 'odometries'),
        ]
    )
    texts = [text(b'x' * length) for length in (*range(10), 100, 1000)]
    odometries_sent = [odometry(child=b'base_link_1')]  # what lies between fields is not defined
    with (
        bench.bridge(config) as bridge,
        publish(bench, '/strings', texts, '--typed'),
        publish(bench, '/odometries', odometries_sent, '--typed', message_type=kind),
    ):
        of_strings, of_odometries = (
            bench.records(strings, len(texts)),
            bench.records(odometries, 1),
        )
        assert bridge.end() == 0
    assert values(of_strings) == texts
    assert values(of_odometries) == odometries_sent
    for message_type, sent in ((STRING, texts), (kind, odometries_sent)):
        python_class = load_type(message_type).python_class
        again = [serialize_message(deserialize_message(value, python_class)) for value in sent]
        assert again == sent


def test_cdr_comes_back_the_same_after_two_bridges_in_both_byte_orders(
    bench: Bench, unique: Unique
) -> None:
    kinds = {STRING: unique('strings'), 'nav_msgs/msg/Odometry': unique('odometries')}
    sent = {
        kinds[STRING]: [text(b'x' * length, order) for length in range(10) for order in '<>'],
        kinds['nav_msgs/msg/Odometry']: [odometry(order) for order in '<><>'],
    }
    for stem in kinds.values():
        bench.create_topic(f'{stem}.a')
    with (
        bench.bridge(
            bench.config(there_and_back(kinds, 'a', 'b'), name=f'{bench.name}-first')
        ) as first,
        bench.bridge(
            bench.config(there_and_back(kinds, 'b', 'c'), name=f'{bench.name}-second')
        ) as second,
    ):
        for stem, messages in sent.items():
            bench.produce(f'{stem}.a', list(messages))
        for stem, messages in sent.items():
            assert values(bench.records(f'{stem}.c', len(messages))) == messages
        assert (first.end(), second.end()) == (0, 0)


def there_and_back(kinds: dict[str, str], source: str, sink: str) -> list[dict[str, Any]]:
    """For each type a route from one Kafka topic to ROS, and one from there to another."""
    routes = []
    for number, (kind, stem) in enumerate(kinds.items()):
        ros = f'/{source}{number}'
        there = to_ros(f'{stem}.{source}', ros, name=f'there{number}', format='cdr')
        there['to']['type'] = kind
        routes += [there, route(ros, f'{stem}.{sink}', kind, f'back{number}')]
    return routes


# Loops


def test_a_bridge_skips_its_own_records_so_that_no_loop_closes(
    bench: Bench, topic_name: str
) -> None:
    bench.create_topic(topic_name)
    out = bench.config([to_kafka('/orders', topic_name)])
    back = bench.config([to_ros(topic_name, '/orders')])
    with (
        bench.bridge(out) as first,
        bench.bridge(back) as second,
        bench.publisher('/orders', '--count', '500'),
    ):
        records = bench.records(topic_name, 500)
        bench.produce(topic_name, [b'from elsewhere'])
        assert values(bench.records(topic_name, 502))[500:] == 2 * [b'from elsewhere']
        assert (first.end(), second.end()) == (0, 0)
    assert values(records) == numbered('', 500)
    assert re.search(r'502 taken, 1 confirmed.* 501 skipped', second.output())
