"""The example configurations, as they are, with real messages of the types they are about."""

import array
import time
from pathlib import Path

import pytest
from confluent_kafka import Producer
from geometry_msgs.msg import TransformStamped, TwistStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage
from support.bridges.routes import lines, values
from support.install.checkout import example
from support.processes.harness import Bench, Process, eventually

EXAMPLES = Path(__file__).parents[2] / 'examples'
FILES = sorted(EXAMPLES.glob('*.yaml'))


def hexed(bench: Bench, name: str, messages: list[bytes]) -> str:
    """A file with the messages, for the peers that publish bytes."""
    file = bench.place / name
    file.write_text(''.join(f'{message.hex()}\n' for message in messages))
    return str(file)


def publisher(bench: Bench, topic: str, kind: str, file: str, *options: str) -> Process:
    return bench.publisher(topic, '--type', kind, '--file', file, *options)


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_every_example_is_well_written(bench: Bench, file: Path) -> None:
    assert bench.command('check', str(file))[0] == 0


def test_orders_come_in_and_status_goes_out(own_bench: Bench) -> None:
    bench = own_bench
    orders = [b'order %d' % number for number in range(50)]
    status = [b'done %d' % number for number in range(50)]
    bench.create_topic('orders', 'robots.status')
    bench.produce('orders', orders)
    received = bench.place / 'received'
    with (
        bench.run(example(bench, 'orders_and_status')) as bridge,
        bench.subscriber('/orders', received),
        bench.publisher('/robot_status', '--count', '50', '--prefix', 'done ') as robot,
    ):
        robot.wait_for('published')
        records = bench.records('robots.status', 50)
        assert values(records) == status
        assert {record.key() for record in records} == {b'/robot_status'}
        eventually(lambda: lines(received) == [order.decode() for order in orders], 60)
        assert bridge.end() == 0


def test_of_two_bridges_one_runs_the_route(own_bench: Bench) -> None:
    bench = own_bench
    bench.create_topic('robots.status')
    file = example(bench, 'two_bridges')
    homes = [str(bench.place / machine) for machine in ('first', 'second')]
    with bench.run(file, HOME=homes[0]) as active, bench.run(file, HOME=homes[1]) as other:
        eventually(lambda: 'takes over' in active.output() + other.output(), 60)
        eventually(lambda: 'stands by' in active.output() + other.output(), 60)
        with bench.publisher('/robot_status', '--count', '50', '--prefix', 'done ') as robot:
            robot.wait_for('published')
            records = bench.records('robots.status', 50)
        assert values(records) == [b'done %d' % number for number in range(50)]
        assert active.end() == other.end() == 0


def test_a_map_and_fixed_transforms_reach_who_comes_later(own_bench: Bench) -> None:
    bench = own_bench
    grid = OccupancyGrid(data=array.array('b', [0, 100] * 50_000))
    grid.info.width, grid.info.height = 500, 200
    site = serialize_message(grid)
    # The package of tf2_msgs/TFMessage is not among the wheels of ROS 2; the route takes any type.
    transforms = [serialize_message(TransformStamped(child_frame_id=f'f{n}')) for n in range(5)]
    bench.create_topic('site-1.map', 'site-1.tf_static')
    latched = ('--durability', 'transient_local', '--readers', '0')
    map_type, tf_type = 'nav_msgs/msg/OccupancyGrid', 'geometry_msgs/msg/TransformStamped'
    with (
        publisher(bench, '/map', map_type, hexed(bench, 'map', [site]), *latched) as mapper,
        publisher(bench, '/tf_static', tf_type, hexed(bench, 'tf', transforms), *latched) as robot,
    ):
        mapper.wait_for('published')
        robot.wait_for('published')
        for _ in range(2):  # later than what it carries, and then again
            with bench.run(example(bench, 'latched')) as bridge:
                bridge.wait_for('map: subscribes to /map')
                bridge.wait_for('subscribes to /tf_static')
                assert values(bench.records('site-1.map', 1)) == [site]
                assert values(bench.records('site-1.tf_static', 5)) == transforms
                assert bridge.end() == 0
    copy = bench.place / 'copy'
    with bench.run(example(bench, 'latched_to_robots')) as bridge:
        eventually(lambda: bench.committed('site-2.map', 'site-1.map') == 1, 60)
        words = '--type', map_type, '--form', 'hex', '--durability', 'transient_local'
        with bench.subscriber('/site_1/map', copy, *words):
            eventually(lambda: len(lines(copy)) > 0, 60)
        assert bridge.end() == 0
    assert [bytes.fromhex(line) for line in lines(copy)] == [site]


def test_pictures_at_best_effort_arrive_as_they_were(own_bench: Bench) -> None:
    bench = own_bench
    bench.create_topic('robot-7.camera')
    pictures = [
        serialize_message(CompressedImage(format='jpeg', data=bytes([number]) * 40_000))
        for number in range(250)
    ]
    file = hexed(bench, 'pictures', pictures)
    topic, kind = '/camera/image_raw/compressed', 'sensor_msgs/msg/CompressedImage'
    options = ('--reliability', 'best_effort', '--rate', '20')
    with (
        bench.run(example(bench, 'camera')) as bridge,
        publisher(bench, topic, kind, file, *options),
    ):
        # What the network loses of them is lost: that is what best effort says.
        eventually(lambda: bench.reaches('robot-7.camera', 50), 60, bridge.output)
        assert bridge.end() == 0
    found = values(bench.records('robot-7.camera', 50))
    assert set(found) <= set(pictures)
    assert found == sorted(found, key=pictures.index)
    assert f'subscribes to {topic} (best_effort, volatile)' in bridge.output()


def test_old_commands_do_not_move_a_robot(own_bench: Bench) -> None:
    bench = own_bench
    bench.create_topic('robot-7.velocity')
    moves = []
    for number in range(3):
        move = TwistStamped()
        move.twist.linear.x = float(number)
        moves.append(serialize_message(move))
    before, stale, fresh = moves
    received = bench.place / 'received'
    bench.produce('robot-7.velocity', [before])
    with (
        bench.run(example(bench, 'commands')) as bridge,
        bench.subscriber(
            '/cmd_vel', received, '--type', 'geometry_msgs/msg/TwistStamped', '--form', 'hex'
        ) as robot,
    ):
        robot.wait_for('ready')
        bridge.wait_for('first start of this group')
        long_ago_ms = int(time.time() * 1000) - 60_000
        bench.produce('robot-7.velocity', [stale], timestamp=long_ago_ms)
        producer = Producer({'bootstrap.servers': bench.bootstrap_servers, 'linger.ms': 0})

        def moved() -> bool:
            producer.produce('robot-7.velocity', fresh)  # anew: a slow machine makes one too old
            producer.flush(10)
            return bool(lines(received))

        eventually(moved, 60)
        assert bridge.end() == 0
    assert {bytes.fromhex(line) for line in lines(received)} == {fresh}
