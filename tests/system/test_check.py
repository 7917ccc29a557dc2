"""`check` as a user meets it, of what is not in the gate."""

from collections.abc import Callable

from harness import Bench, to_ros

Unique = Callable[[str], str]


# Here since it was run again once beside two busy loops: `check --connect` had ended with 1, and
# what it had said was not kept. 32 runs after that passed, 8 of them on a Kafka made for each.
# tests/unit/ros/test_matching.py keeps in the gate what it shows.
def test_routes_of_one_file_count_for_each_other(bench: Bench, unique: Unique) -> None:
    orders, returned = unique('orders'), unique('returned')
    bench.create_topic(orders)
    bench.create_topic(returned)
    back = {'name': 'back', 'from': {'ros': '/orders'}, 'to': {'kafka': returned}}
    file = bench.config([to_ros(orders, '/orders', name='out'), {**back, 'format': 'text'}])
    status, out, _ = bench.command('check', str(file), '--connect')
    assert status == 0, out
    assert '  ok   1 subscriber of /orders matches, with route back of this file' in out
    assert '  ok   route out of this file publishes /orders' in out
    assert out.splitlines()[-1] == '2 routes would run'
