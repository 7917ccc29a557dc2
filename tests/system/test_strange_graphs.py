"""A stranger in DDS tells of itself what rclpy cannot hand over: guarantee 6b.

`tests/unit/ros/test_strange_graphs.py` has what the bridge makes of it.
"""

from collections.abc import Callable
from typing import Any

import pytest
from support.bridges.routes import values
from support.monitoring.scrapes import watched
from support.processes.harness import Bench, eventually
from support.ros.dds_stranger import negative_lifespan, stranger
from support.ros.raw import publish, route, text

LATCHED = ('--durability', 'transient_local', '--readers', '0')


@pytest.mark.parametrize(
    'strange', [{'qos': negative_lifespan()}, {'type_name': b'caf\xe9::msg::dds_::Menu_'}]
)
def test_guarantee_6b_a_stranger_in_the_graph_ends_nothing(
    bench: Bench, unique: Callable[[str], str], strange: dict[str, Any]
) -> None:
    orders, other, learned = unique('orders'), unique('other'), unique('learned')
    routes = [
        route('/orders', orders, 'std_msgs/msg/String', 'orders'),
        route('/other', other, 'std_msgs/msg/String', 'other'),
        route('/learned', learned, None, 'learned'),
        {
            'name': 'back', 'from': {'kafka': unique('back')},
            'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'}, 'format': 'text',
        },
    ]  # fmt: skip
    bridge = watched(bench, routes)
    many = [text(b'%d' % number) for number in range(400)]
    with bridge.process as process, publish(bench, '/orders', many, '--rate', '20') as before:
        eventually(lambda: bench.reaches(orders, 20), 60, process.output)
        with (
            stranger(bench.domain, b'rt/orders', **strange),
            stranger(bench.domain, b'rt/learned', **strange),
        ):
            process.wait_for('somebody in the ROS graph tells what cannot be read')
            process.wait_for('new publishers of /orders are not followed')
            # Who was there is taken from, and who comes elsewhere.
            assert values(bench.records(orders, 400)) == many
            with publish(bench, '/other', [text(b'a')], *LATCHED):
                assert values(bench.records(other, 1)) == [text(b'a')]
            assert before.end() == 0
            bridge.becomes('livez', 200)
            # All others, or that nobody can tell of them.
            shown = '/other' if 'qos' in strange else 'somebody in the ROS graph'
            eventually(lambda: shown in bridge.get('api/graph').text, 60, process.output)
            status, out, _ = bench.command('topics', str(bridge.config))
            assert orders in out
            assert status == int('type_name' in strange)
            status, out, _ = bench.command('check', '--connect', str(bridge.config))
            said = ' '.join(out.split())
            assert 'BAD publishers of /orders: somebody in the ROS graph tells what' in said
            assert f'publishes {other}' in said or '/other' in said
        # It has gone.
        for ros, kafka, come in (('/orders', orders, 401), ('/learned', learned, 1)):
            with publish(bench, ros, [text(b'b')], *LATCHED):
                assert values(bench.records(kafka, come))[-1] == text(b'b')
        assert process.end() == 0
    assert 'Traceback' not in process.output()
