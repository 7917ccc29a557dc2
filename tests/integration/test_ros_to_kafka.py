"""ROS -> Kafka as its users see it: headers, keys, publishers of every kind, loops.

The guarantees are those of docs: 2 at least once without duplicates, 3 order, 4 full means wait.
"""

import re
import signal
import struct
import time
from collections.abc import Callable
from typing import Any

from support.bridges.numbers_to_kafka import told
from support.bridges.routes import to_kafka, to_ros, totals, values
from support.processes.harness import Bench, eventually, headers
from support.processes.lifetimes import Leave
from support.ros.raw import STRING, identities, of, publish, route, text

from ros2_kafka_bridge.ros.types import load_type

Unique = Callable[[str], str]


def pose(frame: str) -> bytes:
    """The CDR bytes of a geometry_msgs/PoseStamped."""
    name = frame.encode() + b'\0'
    front = struct.pack('<iII', 1, 2, len(name)) + name
    return b'\0\1\0\0' + front + bytes(-len(front) % 8) + struct.pack('<7d', *range(7))


def last(bench: Bench, topic: str) -> bytes:
    """The last value just now of a topic that something has come to."""
    return values(bench.records(topic, bench.end_offset(topic)))[-1]


def numbered(prefix: str, count: int) -> list[bytes]:
    """What rig/peers/publisher.py publishes."""
    return [f'{prefix}{number}'.encode() for number in range(count)]


# Headers and keys


def test_headers_name_topic_type_publisher_number_time_and_origin_guarantee_2(
    bench: Bench, topic_name: str
) -> None:
    before_ns = time.time_ns()
    sent = [text(b'%d' % number) for number in range(100)]
    config = bench.config([to_kafka('/orders', topic_name)])
    with bench.drained(config), publish(bench, '/orders', sent) as publisher:
        records = bench.records(topic_name, 100)
        gid = told(publisher, 'gid')
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
            'bridge.route': 'to_kafka',
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
        bench.drained(config),
        publish(bench, '/orders', [text(b'a'), text(b'b')], '--readers', '2') as publisher,
        publish(bench, '/poses', poses, message_type=stamped),
    ):
        of_gid, of_data = bench.records(by_gid, 2), bench.records(by_data, 2)
        of_frame = bench.records(by_frame, 2)
        gid = told(publisher, 'gid')
    assert [record.key() for record in of_gid] == 2 * [f'from {gid}'.encode()]
    assert [record.key() for record in of_data] == [b'/orders/a', b'/orders/b']
    assert [record.key() for record in of_frame] == [b'map', b'odom']
    assert values(of_frame) == poses


def test_a_key_of_a_field_that_the_type_lacks_fails_the_route_and_names_it(
    bench: Bench, topic_name: str
) -> None:
    ends: dict[str, Any] = {
        'from': {'ros': '/orders'},
        'to': {'kafka': topic_name, 'key': '{message.x}'},
    }
    config = bench.config([to_kafka('/orders', topic_name, **ends)])
    options = ('--count', '0', '--readers', '0')
    with bench.drained(config) as bridge, bench.publisher('/orders', *options):
        bridge.wait_for('failed: std_msgs/msg/String has no number or text at x')
    assert 'subscribes to' not in bridge.output(), 'a publisher would begin for nobody'


# Publishers of every kind


def test_a_best_effort_publisher_is_followed_in_order_guarantee_3(
    bench: Bench, topic_name: str
) -> None:
    """It may lose some on a busy machine; the bridge counts those."""
    enough = bench.place / 'enough'
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--reliability', 'best_effort', '--until', str(enough), '--rate', '300')
    with bench.bridge(config) as bridge, bench.publisher('/orders', *options):
        eventually(lambda: bench.reaches(topic_name, 300), 60, bridge.output)
        enough.touch()
        bridge.wait_for('subscribes to /orders (best_effort, volatile)')
        assert bridge.end() == 0
        found = totals(bridge, 'to_kafka')
        records = bench.records(topic_name, found['confirmed'])
    seqs = [seq for _, seq in identities(records)]
    assert seqs == sorted(set(seqs))
    assert seqs[-1] - seqs[0] + 1 == len(seqs) + found.get('lost before the bridge', 0)
    assert values(records) == [b'%d' % (seq - 1) for seq in seqs]


def test_the_whole_history_of_a_transient_local_publisher_arrives_guarantee_8(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--durability', 'transient_local', '--count', '3000', '--readers', '0')
    with bench.publisher('/orders', *options) as publisher:
        publisher.wait_for('published 3000')
        with bench.drained(config):
            records = bench.records(topic_name, 3000)
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
        bench.drained(config),
        bench.publisher('/orders', '--count', '3000', '--prefix', 'a'),
        bench.publisher('/orders', '--count', '3000', '--prefix', 'b'),
    ):
        records = bench.records(topic_name, 6000)
    assert len(records) == 6000
    assert of(b'a', records) == numbered('a', 3000)
    assert of(b'b', records) == numbered('b', 3000)
    assert len({gid for gid, _ in identities(records)}) == 2


def test_what_a_keep_last_publisher_overwrites_is_counted_and_said_guarantee_2(
    bench: Bench, topic_name: str
) -> None:
    count, leave = 10_000, Leave(bench.place)  # much more than what DDS holds for the bridge
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--depth', '1', '--count', str(count), *leave.options)
    with bench.bridge(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(1)
        bench.records(topic_name, 1)
        bridge.send(signal.SIGSTOP)
        leave.up_to(count)
        publisher.wait_for('published')
        bridge.send(signal.SIGCONT)
        eventually(lambda: last(bench, topic_name) == b'%d' % (count - 1), 60)
        assert bridge.end() == 0
        records = bench.records(topic_name, totals(bridge, 'to_kafka')['confirmed'])
    seqs = [seq for _, seq in identities(records)]
    assert seqs == sorted(set(seqs))
    assert 'messages of /orders were lost before the bridge' in bridge.output()
    found = totals(bridge, 'to_kafka')
    assert found['lost before the bridge'] == count - len(seqs)
    assert found['taken'] == found['confirmed'] == len(seqs)


# Loops


def test_two_files_of_one_name_that_mirror_a_topic_skip_their_own_so_that_no_loop_closes(
    bench: Bench, topic: str
) -> None:
    out = bench.config([to_kafka('/orders', topic)])
    back = bench.config([to_ros(topic, '/orders', skip_own=True)])
    with (
        bench.bridge(out) as first,
        bench.bridge(back) as second,
        bench.publisher('/orders', '--count', '500'),
    ):
        records = bench.records(topic, 500)
        bench.produce(topic, [b'from elsewhere'])
        assert values(bench.records(topic, 502))[500:] == 2 * [b'from elsewhere']
        assert (first.end(), second.end()) == (0, 0)
    assert values(records) == numbered('', 500)
    assert re.search(r'502 taken, 1 confirmed.* 501 skipped', second.output())
