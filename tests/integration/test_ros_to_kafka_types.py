"""ROS -> Kafka as its users see it: the types of a topic, and their bytes.

The guarantees are those of docs: 5 one bad record stops nothing.
"""

import struct
from collections.abc import Callable
from typing import Any

from support.bridges.routes import to_kafka, to_ros, values
from support.processes.harness import Bench, headers
from support.ros.raw import STRING, publish, route, text

from ros2_kafka_bridge.ros.types import load_type

Unique = Callable[[str], str]


def odometry(order: str = '<', child: bytes = b'base_link') -> bytes:
    """The CDR bytes of a nav_msgs/Odometry with a different number in each field."""
    header = b'\0\1\0\0' if order == '<' else b'\0\0\0\0'
    size = len(child) + 1
    names = struct.pack(f'{order}iII4sI{size}s', 7, 8, 4, b'map\0', size, child)
    numbers = struct.pack(f'{order}85d', *(number / 7 for number in range(85)))
    return header + names + bytes(-len(names) % 8) + numbers


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
        bench.drained(config) as bridge,
        publish(bench, '/mixed', [text(b'x'), text(b'y')]),
    ):
        assert values(bench.records(topic_name, 2)) == [text(b'x'), text(b'y')]
        bridge.wait_for('publishes std_msgs/msg/Int32 on /mixed, this route reads std_msgs/msg/S')
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
    with bench.drained(bench.config([route('/odom', topic_name, None, 'odometry')])) as bridge:
        bridge.wait_for('runs 1 route on')


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
        bench.drained(config),
        publish(bench, '/strings', texts, '--typed'),
        publish(bench, '/odometries', odometries_sent, '--typed', message_type=kind),
    ):
        of_strings, of_odometries = (
            bench.records(strings, len(texts)),
            bench.records(odometries, 1),
        )
    assert values(of_strings) == texts
    assert values(of_odometries) == odometries_sent
    for message_type, sent in ((STRING, texts), (kind, odometries_sent)):
        python_class = load_type(message_type, 'import').endpoint_class
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
