"""The node of a bridge: diagnostics, lifecycle, services, parameters, as ROS tools use them."""

import itertools
import json
import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from support.bridges.routes import lines, to_kafka, to_ros
from support.processes.harness import Bench, Process, eventually, wait_until_it_reads
from support.ros.caller import caller, controlled

from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node

JAZZY = Path(__file__).parents[2] / '.venv-jazzy' / 'bin' / 'python'
OK, WARN, ERROR = 0, 1, 2
COUNT = 20_000
NODE = {'listen': 'off', 'node': True}


def monitored(bench: Bench, routes: list[dict[str, Any]], **more: Any) -> Path:
    return bench.config(routes, monitoring={**NODE, **more}, kafka=bench.patient_kafka)


def edit(config: Path, old: str, new: str) -> None:
    text = config.read_text()
    assert old in text
    config.write_text(text.replace(old, new))


def sane(bridge: Process) -> bool:
    """Whether nothing in its log looks like a bug."""
    return 'Traceback' not in bridge.output() and 'was not answered' not in bridge.output()


# Lifecycle


def test_a_bridge_comes_up_active_and_deactivate_drains_and_commits_under_load(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    sent = [f'{number}'.encode() for number in range(COUNT)]
    file = tmp_path / 'received'
    config = monitored(bench, [to_ros(topic, '/orders', max_rate=2000)])
    with (
        bench.subscriber('/orders', file),
        controlled(bench, config) as (bridge, node),
    ):
        assert not node.change('configure')  # its client is there before the load begins
        bench.produce(topic, list(sent))
        for part in (1000, COUNT // 2):
            eventually(lambda part=part: len(lines(file)) > part, 60, bridge.output)  # type: ignore[misc]
            assert node.change('deactivate'), bridge.output()
            assert node.state == 'inactive'
            assert len(lines(file)) < COUNT, 'it was not under load any more'
            committed = bench.committed(bench.group, topic)
            eventually(lambda n=committed: len(lines(file)) == n, 60, bridge.output)  # type: ignore[misc]
            assert node.wait_for('bridge', WARN, 'activate').values
            assert len(lines(file)) == committed
            assert node.change('activate'), bridge.output()
            assert node.state == 'active'
        eventually(lambda: len(lines(file)) >= COUNT, 60, bridge.output)
        assert bridge.end() == 0, bridge.output()
    assert lines(file) == [value.decode() for value in sent]
    assert sane(bridge), bridge.output()


def test_a_transition_that_takes_long_holds_nothing_else_up(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders', drain_s=20, max_in_flight=50)])
    bench.produce(topic_name, [b'x'] * 2000)
    with (
        # It takes so slowly that no drain ends by itself.
        bench.subscriber('/orders', tmp_path / 'slow', '--work', '1', samples=10),
        controlled(bench, config) as (bridge, node),
    ):
        # The clients of all that is called below are there before the drain begins.
        assert not node.change('configure')
        assert node.parameters()
        assert node.trigger('to_ros/pause')[0]
        assert node.trigger('to_ros/resume')[0]
        eventually(lambda: len(lines(tmp_path / 'slow')) > 0, 60, bridge.output)
        drain = node.begin('deactivate')
        eventually(lambda: node.state == 'deactivating', 60, bridge.output)
        assert not node.change('activate')  # one at a time
        assert node.parameters()['bridge_name'] == bench.name
        assert node.trigger('to_ros/pause')[0]
        assert node.diagnostics()
        assert not drain.done(), bridge.output()
        assert node.wait(drain).success, bridge.output()
        assert node.state == 'inactive'
        assert bridge.end() == 0, bridge.output()
    assert 'nothing before that has ended' in bridge.output()


def test_a_transition_that_is_not_possible_is_refused_with_those_that_are(
    bench: Bench, topic_name: str
) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders')])
    with controlled(bench, config) as (bridge, node):
        for label in ('configure', 'activate', 'transition_success', 'nonsense'):
            assert not node.change(label)
        assert node.state == 'active'
        bridge.wait_for('can do deactivate, shutdown', count=4)
        assert bridge.end() == 0, bridge.output()


# Services and parameters


def test_a_route_is_paused_and_resumed_by_service_and_by_parameter_and_the_others_go_on(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    topics = [unique('a'), unique('b')]
    files = [tmp_path / 'a', tmp_path / 'b']
    routes = [to_ros(topics[0], '/a', 'a.first'), to_ros(topics[1], '/b', 'b')]
    with (
        bench.subscriber('/a', files[0]),
        bench.subscriber('/b', files[1]),
        bench.bridge(monitored(bench, routes)) as bridge,
        caller(bench.domain, bench.node) as node,
    ):

        def arrived(first: int, second: int) -> None:
            for topic in topics:
                bench.produce(topic, [b'x'] * 10)
            for file, count in zip(files, (first, second), strict=True):
                eventually(lambda f=file, n=count: len(lines(f)) == n, 60, bridge.output)  # type: ignore[misc]

        arrived(10, 10)
        assert node.trigger('a_first/pause')[0]
        node.wait_for('a.first', WARN, 'paused')
        assert node.diagnostics()['b'].level == bytes([OK])
        arrived(10, 20)
        eventually(lambda: bool(node.parameters()['routes.a_first.paused']), 60)
        assert node.assign('routes.a_first.paused', value=False) == (True, '')
        arrived(30, 30)
        assert node.assign('routes.b.paused', value=True)[0]
        node.wait_for('b', WARN, 'paused')
        arrived(40, 30)
        assert node.trigger('b/resume')[0]
        eventually(lambda: not node.parameters()['routes.b.paused'], 60)
        assert bridge.end() == 0, bridge.output()
    assert len(lines(files[1])) == 40
    assert sane(bridge), bridge.output()


def test_parameters_show_the_bridge_and_what_stands_in_its_file_cannot_be_set(
    bench: Bench, topic_name: str
) -> None:
    config = monitored(bench, [to_kafka('/status', topic_name, '9-status')])
    with bench.bridge(config) as bridge, caller(bench.domain, bench.node) as node:
        eventually(lambda: 'routes.route_9_status.paused' in node.parameters(), 60)
        shown = node.parameters()
        assert shown['config_file'] == str(config)
        assert shown['bridge_name'] == bench.name
        assert shown['version']
        route = {name.rpartition('.')[2]: v for name, v in shown.items() if 'route_9' in name}
        assert route == {
            'name': '9-status',
            'source': '/status',
            'sink': topic_name,
            'type': 'std_msgs/msg/String',
            'format': 'text',
            'paused': False,
        }
        for name in ('config_file', 'routes.route_9_status.source'):
            done, why = node.assign(name, value='other')
            assert not done
            assert 'read-only' in why
        assert not node.assign('routes.route_9_status.paused', value='yes')[0]
        assert not node.assign('routes.no_such_route.paused', value=True)[0]
        assert node.parameters() == shown
        assert bridge.end() == 0, bridge.output()


def test_services_and_parameters_follow_the_routes_over_a_reload(bench: Bench, topic: str) -> None:
    config = monitored(bench, [to_ros(topic, '/a', 'a'), to_ros(topic, '/b', 'b')])
    with bench.bridge(config) as bridge, caller(bench.domain, bench.node) as node:
        eventually(lambda: 'b/pause' in node.services(), 60, bridge.output)
        edit(config, 'name: b\n', 'name: c\n')
        done, text = node.trigger('preview_reload')
        assert done
        assert 'b' in text
        assert 'b/pause' in node.services()
        done, text = node.trigger('reload')
        assert done, text
        eventually(lambda: 'c/pause' in node.services(), 60, bridge.output)
        eventually(lambda: 'b/pause' not in node.services(), 60, bridge.output)
        names = set(node.parameters())
        assert {'routes.a.paused', 'routes.c.paused', 'routes.c.source'} <= names
        assert not any(name.startswith('routes.b.') for name in names)
        edit(config, 'name: c\n', 'name: c d\n')
        done, text = node.trigger('reload')
        assert not done
        assert str(config) in text
        assert node.wait_for('bridge', WARN, 'reload')
        assert {'a', 'c'} <= set(node.diagnostics())
        assert bridge.end() == 0, bridge.output()
    assert sane(bridge), bridge.output()


# Diagnostics


def test_diagnostics_say_each_second_how_every_route_is(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    topic, back = unique('orders'), unique('back')
    routes = [to_ros(topic, '/orders', 'orders'), to_kafka('/status', back, 'status')]
    bench.create_topic(back)
    bench.produce(topic, [b'1'] * 100)
    file = tmp_path / 'received'
    with (
        bench.bridge(monitored(bench, routes)) as bridge,
        caller(bench.domain, bench.node) as node,
    ):
        node.wait_for('orders', WARN, 'waiting')
        with bench.subscriber('/orders', file):
            orders = node.wait_for('orders', OK, 'running')
            eventually(
                lambda: dict(_values(node.diagnostics()['orders']))['confirmed'] == '100', 60
            )
            assert orders.name == f'{bench.node[1:]}: orders'
            assert orders.hardware_id == bench.name
            shown = _values(orders)
            assert shown['source'] == topic
            assert shown['sink'] == '/orders'
            for key in ('rate (1/s)', 'in flight', 'lag (records)', 'matched', 'dead lettered'):
                assert key in shown
        found = node.diagnostics()
        assert set(found) == {'bridge', 'worker 1', 'orders', 'status'}
        assert found['bridge'].message.startswith('active, 2 routes')
        with bench.subscriber('/status', tmp_path / 'other'):
            pass
        assert bridge.end() == 0, bridge.output()


def _values(status: Any) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


# What must not harm it


def test_the_node_takes_the_name_and_the_namespace_that_launch_gives_it(
    bench: Bench, topic_name: str
) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders')])
    ros = json.dumps(['-r', '__node:=shop', '-r', '__ns:=/robot1', '-r', '~/reload:=~/again'])
    with (
        bench.bridge(config, ROS2_KAFKA_BRIDGE_ROS_ARGS=ros) as bridge,
        caller(bench.domain, '/robot1/shop') as node,
    ):
        eventually(lambda: node.state == 'active', 60, bridge.output)
        assert node.diagnostics()['bridge'].name == 'shop: bridge'
        assert node.trigger('again')[0]
        assert bridge.end() == 0, bridge.output()


def test_another_node_of_the_same_name_is_warned_of(bench: Bench, topic_name: str) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders')])
    with (
        open_node(bench.name, bench.domain, Histories({}, {})),
        bench.drained(config) as bridge,
    ):
        bridge.wait_for(f'another node is called {bench.node}', 60)


def test_malformed_requests_end_nothing(bench: Bench, topic_name: str) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders')])
    values = [
        ParameterValue(type=77),
        ParameterValue(type=ParameterType.PARAMETER_NOT_SET),
        ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=math.nan),
        ParameterValue(type=ParameterType.PARAMETER_STRING, string_value='x' * 1_000_000),
    ]
    names = ('', '.', 'routes', 'routes..paused', 'routes.to_ros.paused', 'x' * 100_000, '\n\x07')
    with controlled(bench, config) as (bridge, node):
        for name, value in itertools.product(names, values):
            node.start(
                SetParameters, 'set_parameters', parameters=[Parameter(name=name, value=value)]
            )
        for transition in (Transition(id=255), Transition(label='\n' * 1000), Transition()):
            assert not node.call(ChangeState, 'change_state', transition=transition).success
        eventually(lambda: 'was not answered' in bridge.output(), 60, bridge.output)
        assert node.parameters()['routes.to_ros.paused'] is False
        assert node.trigger('preview_reload')[0]
        assert node.diagnostics()
        assert bridge.output().count('the monitor is process') == 1
        assert bridge.end() == 0, bridge.output()
    assert 'Traceback' not in bridge.output()


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_stop_during_a_transition_ends_without_a_crash(
    bench: Bench, topic_name: str, tmp_path: Path, number: signal.Signals
) -> None:
    config = monitored(bench, [to_ros(topic_name, '/orders', drain_s=10, max_in_flight=50)])
    bench.produce(topic_name, [b'x'] * 2000)
    with (
        bench.subscriber('/orders', tmp_path / 'slow', '--work', '1', samples=10),
        controlled(bench, config) as (bridge, node),
    ):
        assert not node.change('configure')  # its client is there before the drain begins
        eventually(lambda: len(lines(tmp_path / 'slow')) > 0, 60, bridge.output)
        node.begin('deactivate')
        eventually(lambda: node.state == 'deactivating', 60, bridge.output)
        bridge.send(number)
        assert bridge.wait(60) == 0, bridge.output()
    assert sane(bridge), bridge.output()


def test_on_jazzy_the_node_does_the_same(bench: Bench, topic: str, tmp_path: Path) -> None:
    assert JAZZY.exists(), 'make test makes .venv-jazzy'
    file = tmp_path / 'received'
    config = monitored(bench, [to_ros(topic, '/orders')])
    with (
        bench.subscriber('/orders', file),
        controlled(bench, config, python=JAZZY) as (bridge, node),
    ):
        wait_until_it_reads(bridge, topic)
        assert not node.change('configure')
        assert node.change('deactivate'), bridge.output()
        assert node.change('activate'), bridge.output()
        assert node.trigger('to_ros/pause')[0]
        node.wait_for('to_ros', WARN, 'paused')
        assert node.assign('routes.to_ros.paused', value=False)[0]
        bench.produce(topic, [b'1'])
        eventually(lambda: lines(file) == ['1'], 60, bridge.output)
        assert bridge.end() == 0, bridge.output()
    assert sane(bridge), bridge.output()
