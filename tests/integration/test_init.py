"""`init`: a starting file that is right as it is."""

from collections.abc import Callable
from pathlib import Path

from support.bridges.routes import lines, values
from support.install.checkout import renamed
from support.processes.harness import Bench, eventually
from support.ros.robots import installed, robot


def test_the_starting_file_is_right_and_carries_messages_both_ways(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    file = bench.place / 'bridge.yaml'
    status, out, err = bench.command('init', str(file))
    assert (status, err) == (0, '')
    assert out.splitlines() == [
        f'{file} is written: 2 routes, orders into ROS and status out of it',
        'next: put your brokers and topics into it, then',
        f'  ros2-kafka-bridge check {file} --connect',
        f'  ros2-kafka-bridge run {file}',
    ]
    assert bench.command('check', str(file))[0] == 0
    orders, state = unique('orders'), unique('status')
    bench.create_topic(orders, state)
    renamed(
        file,
        ('localhost:9092', bench.bootstrap_servers),
        ('bridge-1', unique('bridge')),
        ('orders', orders),
        ('status', state),
    )
    received = bench.place / 'received'
    with (
        bench.subscriber('/orders', received) as subscriber,
        bench.drained(file) as bridge,
        bench.publisher('/status', '--count', '10') as publisher,
    ):
        subscriber.wait_for('ready')
        publisher.wait_for('published')
        assert values(bench.records(state, 10)) == [b'%d' % number for number in range(10)]
        bridge.wait_for(f'reads {orders}')
        bench.produce(orders, [b'one order'])
        eventually(lambda: lines(received) == ['one order'], 30)


def test_a_type_that_a_node_alone_describes_becomes_a_route_that_runs(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    prefix = installed(tmp_path, 'acme_tf', {'Moved': 'string text\n', 'Lied': 'int32 x\n'})
    moved = unique('moved').replace('-', '_')
    file = bench.place / 'bridge.yaml'
    message = bytes.fromhex('00010000020000006100')
    publishes = {f'/{moved}': [message]}
    with (
        robot(bench, 'acme_tf/msg/Moved', prefix, publishes=publishes),
        robot(bench, 'acme_tf/msg/Lied', prefix, '--describes', 'lies', publishes={'/lied': []}),
    ):
        servers = '--bootstrap-servers', bench.bootstrap_servers
        status, _, err = bench.command('init', str(file), '--from-graph', *servers)
        assert status == 0, err
        assert 'left as a comment: no message type acme_tf/msg/Lied here, and nobody' in err
        text = file.read_text()
        assert '  # Its type is not installed here: the bridge asks a node that uses it.\n' in text
        assert '  # - name: lied\n' in text
        status, out, _ = bench.command('check', str(file))
        assert status == 0
        asked = f'a node that uses /{moved} is asked for it'
        assert f'note no message type acme_tf/msg/Moved here: {asked}' in out
        renamed(file, ('bridge-1', unique('bridge')))
        with bench.drained(file):
            assert values(bench.records(moved, 1)) == [b'{"text":"a"}']
