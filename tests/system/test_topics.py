"""`topics`: both sides as they are, the routes between them, and who would match."""

import json
from collections.abc import Callable
from typing import Any

from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import Bench
from support.processes.terminal import on_terminal, without_colours
from support.said import OFFERED, row

from ros2_kafka_bridge.testing.local_kafka import free_port

NO_BOOLS = ('--type', 'std_msgs/msg/Bool', '--file', '/dev/null')

Unique = Callable[[str], str]


def of(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """The entry of that name."""
    [found] = [row for row in rows if row['name'] == name]
    return found


def test_without_a_file_names_that_correspond_are_pointed_out(
    bench: Bench, unique: Unique
) -> None:
    robot = unique('robot').replace('-', '_')
    out_topic, in_topic = f'{robot}.odom', f'{robot}.cmd'
    bench.create_topic(out_topic, in_topic)
    with (
        bench.publisher(f'/{robot}/odom', '--count', '0', '--readers', '0') as publisher,
        bench.subscriber(
            f'/{robot}/cmd', bench.place / 'received', '--durability', 'transient_local'
        ) as subscriber,
    ):
        publisher.wait_for('published')
        subscriber.wait_for('ready')
        status, out, _ = bench.command('topics', '--bootstrap-servers', bench.bootstrap_servers)
    assert status == 0
    pairs = out[out.index('Possible pairs, not joined by a route') :]
    assert row(pairs, out_topic) == f'{out_topic} /{robot}/odom ROS to Kafka yes'
    expected = f'{in_topic} /{robot}/cmd Kafka to ROS {OFFERED}; set it in to.qos'
    assert row(pairs, in_topic) == expected


def test_rates_are_counted_on_request_and_json_is_for_programs(bench: Bench, topic: str) -> None:
    file = bench.config([to_kafka('/status', topic)])
    with (
        bench.bridge(file) as bridge,
        bench.publisher('/status', '--count', '100000', '--rate', '100') as publisher,
    ):
        bridge.wait_for('subscribes to /status')
        bench.records(topic, 50)
        status, out, err = bench.command('topics', str(file), '--rates', '3', '--json')
        assert publisher.running
        assert bridge.end() == 0
    assert (status, err) == (0, '')
    view = json.loads(out)
    assert of(view['ros'], '/status')['rate'] > 1
    assert of(view['kafka'], topic)['rate'] > 1
    assert of(view['kafka'], topic)['records'] > 0
    assert of(view['kafka'], topic)['routes'] == [{'route': 'to_kafka', 'does': 'writes'}]
    assert of(view['ros'], '/status')['routes'] == [{'route': 'to_kafka', 'does': 'takes'}]
    [match] = of(view['ros'], '/status')['matches']
    assert match['route'] == 'to_kafka'
    assert match['problem'] == ''
    assert view['seconds'] == 3


def test_counting_is_no_subscriber_that_a_waiting_bridge_would_deliver_to(
    bench: Bench, topic: str
) -> None:
    bench.produce(topic, [b'the only order'])
    file = bench.config([to_ros(topic, '/waiting_orders')])
    with bench.drained(file) as bridge:
        bridge.wait_for('reads ')
        status, out, _ = bench.command('topics', str(file), '--rates', '2')
        assert status == 0
        assert row(out, '/waiting_orders').endswith(' ? to_ros publishes')
    assert bench.committed(bench.group, topic) <= 0, 'it was delivered to nobody'


def test_two_types_on_one_topic_are_both_named(bench: Bench) -> None:
    with (
        bench.publisher('/mixed', '--count', '0', '--readers', '0') as one,
        bench.publisher('/mixed', *NO_BOOLS, '--readers', '0') as other,
    ):
        one.wait_for('published')
        other.wait_for('published')
        servers = ('--bootstrap-servers', bench.bootstrap_servers)
        status, out, _ = bench.command('topics', *servers, '--rates', '0.5')
    assert status == 0
    types = 'std_msgs/msg/Bool; std_msgs/msg/String'
    assert row(out, '/mixed') == f'/mixed {types} 2 reliable, volatile - ? -'


def test_without_a_broker_the_ros_side_is_still_shown(bench: Bench) -> None:
    nobody = f'127.0.0.1:{free_port()}'
    with bench.publisher('/status', '--count', '0', '--readers', '0') as publisher:
        publisher.wait_for('published')
        status, out, err = bench.command('topics', '--bootstrap-servers', nobody)
    assert (status, err) == (1, '')
    assert f'Kafka ({nobody}): the broker does not answer' in out
    assert row(out, '/status') == '/status std_msgs/msg/String 1 reliable, volatile - -'


def test_a_terminal_shows_the_whole_of_each_name(bench: Bench, unique: Unique) -> None:
    name = unique('a_rather_long_topic_name')
    bench.create_topic(name)
    file = bench.config([to_kafka(f'/{name.replace("-", "_")}', name)])
    status, shown = on_terminal('topics', str(file), columns=80)
    found = without_colours(shown)
    assert status == 0
    assert [line.split()[1:3] for line in found if line.split()[:1] == [name]] == [['1', '0']]
    assert max(map(len, found)) <= 80
    assert '…' not in shown
