"""What shows only a part of the ROS graph says so, and takes nobody for not there."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast
from unittest.mock import MagicMock

import pytest
from support.bridges.made_letters import config as letters_config
from support.processes.terminal import typed
from support.said import row

from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.commands.check import ros as check_ros
from ros2_kafka_bridge.commands.depth import sources
from ros2_kafka_bridge.commands.init import write
from ros2_kafka_bridge.commands.topics import report
from ros2_kafka_bridge.commands.topics.report import SideSettings
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, QoS, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.monitoring import graph
from ros2_kafka_bridge.ros import discovery, used_type
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.graph import Graph
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.probe import Abilities
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.route.counters import Snapshot, State
from ros2_kafka_bridge.wiring import Wiring

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.node import RosNode

CURE = 'set ROS_SUPER_CLIENT=TRUE to be told of all'
NOT_TOLD = 'a discovery server does not tell this process who is there'
ABILITIES = Abilities(bounded=True, gid=True, seq=True, denies=True, own=b'')
STRING = 'std_msgs/msg/String'
SEEN = Topic('/seen', [STRING], [Peer.of_qos('/robot', STRING, b'1', '', profile(QoS()))], [])


@pytest.fixture(autouse=True)
def client(monkeypatch: pytest.MonkeyPatch) -> None:
    """This process is a client of a discovery server."""
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11811')
    monkeypatch.delenv('ROS_SUPER_CLIENT', raising=False)
    monkeypatch.setattr(discovery, 'is_fastdds', lambda: True)


class Node:
    """A node that sees these topics, and nobody on others."""

    def __init__(self, *seen: Topic) -> None:
        self._seen = seen

    def topics(self) -> list[Topic]:
        return list(self._seen)

    def publishers(self, _: str) -> list[Peer]:
        return []

    subscribers = publishers


def opens(monkeypatch: pytest.MonkeyPatch, module: object, *seen: Topic) -> None:
    """Let a command meet such a node at once."""

    @contextmanager
    def node(*_: Any) -> Iterator[Node]:
        yield Node(*seen)

    monkeypatch.setattr(module, 'open_node', node)
    monkeypatch.setattr(module, 'wait_for_discovery', lambda: None, raising=False)


def overview(monkeypatch: pytest.MonkeyPatch, *seen: Topic) -> None:
    """Let `topics` meet such a node, and a Kafka without topics."""
    opens(monkeypatch, report, *seen)
    monkeypatch.setattr(report, 'Overview', MagicMock())
    monkeypatch.setattr(report, '_kafka_topics', lambda _: ([], ''))
    monkeypatch.setattr(report, 'middleware', lambda: 'rmw')


def route_config(**source: Any) -> Config:
    """A route from ROS, and one to it."""
    out = {'name': 'out', 'from': {'ros': '/out', **source}, 'to': {'kafka': 'out'}}
    into = {'name': 'in', 'from': {'kafka': 'in'}, 'to': {'ros': '/in', 'type': STRING}}
    routes = [{**route, 'format': 'cdr'} for route in (out, into)]
    kafka = {'bootstrap.servers': 'localhost:9'}
    return validated(Config, {'name': 'b', 'kafka': kafka, 'routes': routes})


def route_from_ros(config: Config) -> RosToKafkaRoute:
    route = config.routes[0]
    assert isinstance(route, RosToKafkaRoute)
    return route


# Routes


def test_a_route_that_waits_for_its_type_says_so_and_the_cure_in_its_log_and_its_state(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(used_type, 'ANNOUNCED_S', 0.0)
    config = route_config()
    bridge = Bridge(config)
    runner, _ = bridge._runners
    told: list[Snapshot] = []

    def publishers(_: str) -> Sequence[Peer]:
        told.append(bridge.snapshots()[0])
        if len(told) == 3:
            runner.stop.ask()
        return []

    graph = Graph(lambda: None)
    node = SimpleNamespace(publishers=publishers, graph=graph)
    wiring = Wiring(config, cast('RosNode', node), ABILITIES, Histories({}, {}), {}, MagicMock())
    bridge._keep_running(runner, wiring, lambda _: None)
    graph.close()
    [line] = [line for line in caplog.messages if 'waits for a publisher of /out' in line]
    assert f'{CURE}, or write from.type' in line
    assert (told[0].state, told[0].reason) == (State.STARTING, '')
    assert (told[2].state, told[2].reason) == (State.STARTING, line)
    runner.ask_to_pause(asked=True)
    assert bridge.snapshots()[0].state is State.PAUSED
    runner.begin()
    runner.ask_to_pause(asked=False)
    assert bridge.snapshots()[0].reason == '', 'the next try begins anew'


# Commands


@pytest.mark.parametrize('needed', [0, 1])
def test_check_names_the_cure_and_says_of_no_topic_that_nobody_is_there(needed: int) -> None:
    config = route_config(type=STRING)
    node = cast('RosNode', Node())
    assert check_ros.sees_none(node)
    [_, note] = check_ros.graph_findings(ABILITIES, config, sees_none=True)
    assert note.level == 'note'
    assert CURE in note.text
    route = config.routes[1]
    assert isinstance(route, KafkaToRosRoute)
    route = replace(route, min_subscribers=needed)
    [readers] = check_ros.reader_findings(route, config, node, None)
    [publishers] = check_ros.publisher_findings(route_from_ros(config), [], STRING)
    for found, topic in ((readers, '/in'), (publishers, '/out')):
        assert found.text == f'{topic}: {NOT_TOLD}; it tells the route itself'
        assert found.waits == '', 'which is not known'


def test_check_says_of_a_route_without_a_type_that_it_waits() -> None:
    [found] = check_ros.publisher_findings(route_from_ros(route_config()), [], None)
    assert found.text.endswith('nor the route, which waits to learn its type')
    assert 'set from.type' in found.cure
    assert found.waits == 'for the type of /out'


def test_check_names_the_cure_also_where_somebody_is_seen() -> None:
    node = cast('RosNode', Node(SEEN))
    assert not check_ros.sees_none(node)
    found = check_ros.graph_findings(ABILITIES, route_config(), sees_none=False)
    assert CURE in found[1].text


@pytest.mark.parametrize('seen', [(), (SEEN,)], ids=['nobody', 'somebody'])
def test_topics_names_the_cure_and_says_of_no_topic_that_nobody_is_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], seen: tuple[Topic, ...]
) -> None:
    overview(monkeypatch, *seen)
    report.report(SideSettings.of(letters_config()), seconds=None, as_json=False)
    out = capsys.readouterr().out
    assert 'nobody' not in out
    assert row(out, '/orders').startswith(f'/orders {NOT_TOLD} ? ?')
    [note] = [line for line in out.splitlines() if CURE in line]
    assert note.startswith('  note ROS: ')


def test_topics_without_a_file_names_the_cure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    overview(monkeypatch)
    report.report(SideSettings.without_file('localhost:9'), seconds=None, as_json=False)
    assert CURE in capsys.readouterr().out


def test_init_names_the_cure_instead_of_others_where_no_topic_is_seen(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    opens(monkeypatch, write)
    status, _, err = typed('init', tmp_path / 'bridge.yaml', '--from-graph')
    assert status == 1
    assert CURE in err
    assert 'Do the nodes run' not in err


def test_init_says_that_there_may_be_more_topics_than_it_has_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    opens(monkeypatch, write, SEEN)
    status, _, err = typed('init', tmp_path / 'bridge.yaml', '--from-graph')
    assert status == 0
    assert 'there may be more topics: ' in err
    assert CURE in err


def test_depth_names_the_cure_where_nobody_is_seen_to_publish(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sources, '_TYPE_S', 0.0)
    with pytest.raises(RouteError, match=CURE) as raised:
        sources._type(cast('RosNode', Node()), '/scan')
    assert 'do they run' not in str(raised.value)


# The page


def test_the_page_names_the_cure_and_says_of_no_topic_that_nobody_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(graph, 'middleware', lambda: 'rmw')
    config = route_config()
    for topics in ([], [SEEN]):
        seen = graph.seen(config, config.routes, topics)
        assert CURE in seen['hidden']
        untold = {row['name']: row['problem'] for row in seen['topics']}
        assert {untold['/in'], untold['/out']} == {NOT_TOLD}
    monkeypatch.setenv('ROS_SUPER_CLIENT', 'TRUE')
    assert graph.seen(config, config.routes, [SEEN])['hidden'] == ''
