"""A ROS that the bridge cannot use ends the start with one sentence, and nothing crashes."""

import shutil
import sysconfig
from pathlib import Path

import pytest
from support.bridges.routes import lines, to_kafka, to_ros
from support.processes.harness import Bench

WHEELS = Path(sysconfig.get_paths()['platlib'])
"""Where the rclpy of the tests lies."""

LIKE_HUMBLE = """\
import sys, rclpy.node, rclpy.event_handler
del rclpy.event_handler
sys.modules['rclpy.event_handler'] = None
"""
HUMBLE_LACKS = (
    'rclpy.event_handler.PublisherEventCallbacks, '
    'rclpy.event_handler.QoSPublisherEventType.RCL_PUBLISHER_MATCHED, '
    'rclpy.event_handler.SubscriptionEventCallbacks: '
)
WITHOUT_INIT_OF_A_DOMAIN = """\
import rclpy
def init(*, args=None, context=None): raise SystemExit('called')
rclpy.init = init
"""
DOMAIN_IS_LACKING = "rclpy.init (got an unexpected keyword argument 'domain_id'): "
WITHOUT_MANAGED_NODE = """\
import rclpy.lifecycle.node
del rclpy.lifecycle.node.LifecycleNodeMixin.trigger_cleanup
"""


def changed(bench: Bench, program: str) -> str:
    """A PYTHONPATH by which that program changes rclpy before the bridge begins."""
    place = bench.place / 'changed'
    place.mkdir()
    (place / 'sitecustomize.py').write_text(program)
    return str(place)


@pytest.mark.parametrize(
    ('program', 'lacks'),
    [(LIKE_HUMBLE, HUMBLE_LACKS), (WITHOUT_INIT_OF_A_DOMAIN, DOMAIN_IS_LACKING)],
    ids=['like humble', 'another init'],
)
def test_an_rclpy_without_what_the_bridge_calls_is_one_sentence(
    bench: Bench, program: str, lacks: str
) -> None:
    file = bench.config([to_kafka('/orders', 'orders')])
    path = changed(bench, program)
    with bench.run(file, PYTHONPATH=path) as bridge:
        assert bridge.wait() == 2
    [sentence] = lines(bridge.log)
    assert sentence.startswith('rclpy ')
    assert f' of {WHEELS / "rclpy"} is too new, or changed: ' in sentence
    assert f' does not have what the bridge calls: {lacks}source a ROS ' in sentence
    status, _, err = bench.command('check', str(file), '--connect', PYTHONPATH=path)
    assert (status, err) == (2, f'{sentence}\n')


def test_a_managed_node_that_this_rclpy_cannot_make_is_told_and_the_routes_run(
    bench: Bench,
) -> None:
    routes, monitoring = [to_kafka('/orders', 'orders')], {'listen': 'off', 'node': True}
    file = bench.config(routes, monitoring=monitoring)
    with bench.run(file, PYTHONPATH=changed(bench, WITHOUT_MANAGED_NODE)) as bridge:
        bridge.wait_for('the ROS node of the bridge cannot run, the routes go on: rclpy ')
        bridge.wait_for('runs 1 route on')
        assert bridge.end() == 0
    assert 'LifecycleNodeMixin.trigger_cleanup: source a ROS' in bridge.output()
    assert 'Traceback' not in bridge.output()


def test_a_sourced_ros_before_the_wheels_is_refused_with_both_places(bench: Bench) -> None:
    file = bench.config([to_ros('orders', '/orders')])
    sourced = bench.place / 'ros' / 'site-packages'
    shutil.copytree(WHEELS / 'rclpy', sourced / 'rclpy')
    with bench.run(file, PYTHONPATH=str(sourced)) as bridge:
        assert bridge.wait() == 2
    [sentence] = lines(bridge.log)
    assert sentence == (
        f'two ROS at once: rclpy is that of {sourced / "rclpy"}, and the wheels of ROS 2 are in '
        f'{WHEELS}: make an environment without the extra [ros] for a sourced ROS, or open a '
        'terminal that has not sourced one'
    )
    status, _, err = bench.command('check', str(file), '--connect', PYTHONPATH=str(sourced))
    assert (status, err) == (2, f'{sentence}\n')
