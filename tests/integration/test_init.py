"""`init`: a starting file that is right as it is."""

from collections.abc import Callable

from harness import Bench, eventually, lines, values
from renaming import renamed


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
    bench.create_topic(orders)
    bench.create_topic(state)
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
        bench.bridge(file) as bridge,
        bench.publisher('/status', '--count', '10') as publisher,
    ):
        subscriber.wait_for('ready')
        publisher.wait_for('published')
        assert values(bench.records(state, 10)) == [b'%d' % number for number in range(10)]
        bridge.wait_for(f'reads {orders}')
        bench.produce(orders, [b'one order'])
        eventually(lambda: lines(received) == ['one order'], 30)
        assert bridge.end() == 0
