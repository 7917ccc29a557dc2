"""`init --from-graph`: a starting file that is right as it is."""

from collections.abc import Callable

from support.bridges.routes import lines, values
from support.install.checkout import renamed
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.testing.local_kafka import free_port

NO_BOOLS = ('--type', 'std_msgs/msg/Bool', '--file', '/dev/null')

Unique = Callable[[str], str]


def test_a_graph_becomes_routes_that_carry_its_messages(bench: Bench, unique: Unique) -> None:
    robot = unique('robot').replace('-', '_')
    file, received = bench.place / 'bridge.yaml', bench.place / 'received'
    bench.create_topic(f'{robot}.cmd', f'{robot}_odom')
    with (
        bench.publisher(f'/{robot}/odom', '--count', '10') as odom,
        bench.publisher(
            f'/{robot}/map', '--count', '1', '--durability', 'transient_local', '--readers', '0'
        ) as latched,
        bench.publisher(f'/{robot}/mixed', '--count', '0', '--readers', '0') as one,
        bench.publisher(f'/{robot}/mixed', *NO_BOOLS, '--readers', '0') as other,
        bench.subscriber(f'/{robot}/cmd', received, '--durability', 'transient_local') as reader,
    ):  # fmt: skip
        latched.wait_for('published')
        one.wait_for('published')
        other.wait_for('published')
        reader.wait_for('ready')
        status, out, err = bench.command(
            'init', str(file), '--from-graph', '--bootstrap-servers', bench.bootstrap_servers
        )
        text = file.read_text()
        assert status == 0, err
        assert f'{file} is written: 3 routes, 2 to Kafka and 1 from it' in out
        assert f'left as a comment: /{robot}/mixed has types' in err
        assert f'  # - name: {robot}_mixed\n' in text
        assert f'    to: {{kafka: {robot}_odom}}\n' in text, 'the name that Kafka has already'
        assert '# Transient local from /publisher_' in text
        assert '/rosout' in text
        assert bench.command('check', str(file))[0] == 0
        renamed(file, ('bridge-1', unique('bridge')))
        with bench.drained(file) as bridge:
            odom.wait_for('published')
            assert len(bench.records(f'{robot}_odom', 10)) == 10
            assert values(bench.records(f'{robot}.map', 1)) == [b'0']
            bridge.wait_for(f'reads {robot}.cmd')
            bench.produce(f'{robot}.cmd', [b'stop'])
            eventually(lambda: lines(received) == ['stop'], 30)


def test_an_empty_graph_is_said_and_nothing_is_written(bench: Bench, ros_domain: int) -> None:
    file = bench.place / 'bridge.yaml'
    status, out, err = bench.command('init', str(file), '--from-graph')
    assert (status, out) == (1, '')
    assert f'no topic is seen in ROS domain {ros_domain} (ROS_DOMAIN_ID), nothing is' in err
    assert 'ROS_AUTOMATIC_DISCOVERY_RANGE' in err
    assert not file.exists()


def test_a_graph_is_written_though_kafka_does_not_answer(bench: Bench) -> None:
    file = bench.place / 'bridge.yaml'
    nobody = f'127.0.0.1:{free_port()}'
    with bench.publisher('/odom', '--count', '0', '--readers', '0') as publisher:
        publisher.wait_for('published')
        status, out, err = bench.command(
            'init', str(file), '--from-graph', '--bootstrap-servers', nobody
        )
    assert (status, len(out.splitlines())) == (0, 4)
    assert f'the file is written without looking at Kafka ({nobody})' in err
    assert '    to: {kafka: odom}\n' in file.read_text()
