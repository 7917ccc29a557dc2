"""What `topics` refuses before it asks anybody, and what it says where it does not know."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.bridges.made_letters import config
from support.processes.terminal import typed
from support.said import row

from ros2_kafka_bridge.commands.topics import report, types
from ros2_kafka_bridge.commands.topics.report import SideSettings
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.overview import KafkaTopic, records
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.ros import rates
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import load_type

STRING = 'std_msgs/msg/String'
STRANGE = 'publishers of /orders: somebody in the ROS graph tells what cannot be read (...)'


def test_a_wrong_file_and_two_answers_for_the_brokers_are_refused(tmp_path: Path) -> None:
    missing = tmp_path / 'missing.yaml'
    assert typed('topics', missing) == (2, '', f'{missing}: no such file\n')
    status, out, err = typed('topics', missing, '--bootstrap-servers', 'x')
    assert (status, out) == (2, '')
    assert err.startswith(f'--bootstrap-servers: {missing} says them already')


class Seen:
    """Both sides: as an overview of Kafka, and as a node of ROS."""

    def __init__(self, kafka: Sequence[KafkaTopic] = (), ros: Sequence[Topic] = ()) -> None:
        self._kafka, self._ros = kafka, ros
        self.offset = 0

    def topics(self) -> Any:
        return list(self._ros or self._kafka)

    def ends(self, topics: Sequence[KafkaTopic]) -> Mapping[tuple[str, int], int]:
        self.offset += 10
        return {(t.name, number): self.offset for t in topics for number in range(t.partitions)}

    def begins(self, topics: Sequence[KafkaTopic]) -> Mapping[tuple[str, int], int]:
        return {(t.name, number): 0 for t in topics for number in range(t.partitions)}


def shown(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kafka: Sequence[KafkaTopic] = (),
    ros: Sequence[Topic] = (),
) -> tuple[str, Any]:
    """What is printed with rates, and as JSON."""

    @contextmanager
    def node(*_: Any) -> Iterator[Seen]:
        yield Seen(ros=ros)

    monkeypatch.setattr(report, 'Overview', lambda _: Seen(kafka))
    monkeypatch.setattr(report, 'open_node', node)
    monkeypatch.setattr(report, 'wait_for_discovery', lambda: None)
    monkeypatch.setattr(report, 'middleware', lambda: 'rmw')
    monkeypatch.setattr(rates, 'count', lambda _, counted, __: dict.fromkeys(counted, 7.0))
    sides = SideSettings.of(config())
    assert report.report(sides, seconds=0.01, as_json=False) == 0
    text = capsys.readouterr().out
    assert report.report(sides, seconds=0.01, as_json=True) == 0
    return text, json.loads(capsys.readouterr().out)


def peer(node: str, type_hash: str = '') -> Peer:
    return Peer.of_qos(node, STRING, b'1', type_hash, profile(QoS()))


def of(rows: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    [found] = [one for one in rows if one['name'] == name]
    return found


def test_of_a_kafka_topic_with_a_problem_no_number_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kafka = [KafkaTopic('orders', 0, 'Broker: Leader not available'), KafkaTopic('well', 2, '')]
    text, view = shown(monkeypatch, capsys, kafka)
    text = text.partition('\nROS')[0]
    assert row(text, 'orders') == 'orders - - - orders reads; Broker: Leader not available'
    assert row(text, 'returned').endswith(
        'returned writes; not there, or this user may not see it'
    )
    for name in ('orders', 'returned'):
        told = of(view['kafka'], name)
        assert (told['partitions'], told['records'], told['rate']) == (None, None, None)
    well = of(view['kafka'], 'well')
    assert (well['partitions'], well['records']) == (2, 40)
    assert well['rate'] > 0


def test_a_topic_without_partitions_does_not_hold_nothing() -> None:
    assert records(KafkaTopic('orders', 0, ''), {}, {}) is None
    assert records(KafkaTopic('orders', 1, ''), {('orders', 0): 5}, {('orders', 0): 5}) == 0


def test_a_ros_topic_where_somebody_cannot_be_read_is_not_one_where_nobody_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, view = shown(monkeypatch, capsys, ros=[Topic('/orders', [], [], [], STRANGE)])
    routes = 'orders publishes; returned takes'
    assert row(text, '/orders') == f'/orders {STRANGE} ? ? ? {routes}'
    assert f'orders - {STRANGE}' in ' '.join(text.split())
    assert 'nobody' not in text
    assert 'Possible pairs' not in text
    told = of(view['ros'], '/orders')
    assert (told['rate'], told['problem']) == (None, STRANGE)


def test_whoever_can_be_read_is_shown_beside_one_who_cannot(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = Topic('/orders', [STRING], [peer('/robot')], [], STRANGE)
    text, view = shown(monkeypatch, capsys, ros=[topic])
    assert row(text, '/orders').startswith(f'/orders {STRING}; {STRANGE} 1 reliable, volatile')
    assert 'returned /robot yes' in ' '.join(text.split())
    assert of(view['ros'], '/orders')['rate'] is None


def test_what_would_match_as_far_as_is_known_is_no_plain_yes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readers = [peer('/silent'), peer('/telling', load_layout(STRING).type_hash or '')]
    text, _ = shown(monkeypatch, capsys, ros=[Topic('/orders', [STRING], [], readers)])
    lines = ' '.join(text.split())
    assert f'/silent as far as is known: whether its definition of {STRING} is the same' in lines
    assert 'orders /telling yes' in lines


def test_where_a_type_is_described_that_is_not_installed_is_told_or_that_it_is_nowhere(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = load_type(STRING)._replace(name='a/msg/Told', origin='is described by the node /robot')
    shown_types = {
        ('/b', 'a/msg/Told'): told,
        ('/b', 'a/msg/No'): RouteError('nobody: because'),
    }
    monkeypatch.setattr(types, 'load_shown', lambda *_: shown_types)
    topic = Topic('/b', ['a/msg/No', 'a/msg/Told', STRING], [peer('/robot')], [])
    text, view = shown(monkeypatch, capsys, ros=[topic])
    marked = 'a/msg/No; not known here; a/msg/Told; described by the node /robot'
    assert row(text, '/b').startswith(f'/b {marked}; {STRING} 1 reliable')
    [note] = [line for line in text.splitlines() if line.startswith('not known here: ')]
    assert 'ros.message_path' in note
    found = of(view['ros'], '/b')
    assert found['type_origins'] == {'a/msg/Told': 'is described by the node /robot'}
    assert found['type_problems'] == {'a/msg/No': 'nobody: because'}


def test_messages_of_a_type_are_counted_that_nodes_alone_describe(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = load_type(STRING)._replace(name='a/msg/Told')
    monkeypatch.setattr(types, 'load_shown', lambda *_: {('/b', 'a/msg/Told'): told})
    topics = [Topic(f'/{it}', ['a/msg/Told'], [peer('/robot')], []) for it in 'bc']
    _, view = shown(monkeypatch, capsys, ros=topics)
    assert of(view['ros'], '/b')['rate'] == 7.0
    assert of(view['ros'], '/c')['rate'] is None, 'nobody describes it there'


def test_a_topic_that_was_made_anew_while_it_was_counted_has_no_rate() -> None:
    topics = [KafkaTopic('orders', 1, ''), KafkaTopic('well', 1, '')]
    before, after = {('orders', 0): 100, ('well', 0): 1}, {('orders', 0): 3, ('well', 0): 3}
    assert report._kafka_rates(topics, before, after, 1.0) == {'well': 2.0}
