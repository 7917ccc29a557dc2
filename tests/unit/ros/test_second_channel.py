"""Lyrical may send pictures and clouds where the bridge hears nothing: who is told of it."""

import logging
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from support.ros.ends import still_node

from ros2_kafka_bridge.commands.check import report
from ros2_kafka_bridge.commands.check import ros as check_ros
from ros2_kafka_bridge.commands.check.types import FoundType
from ros2_kafka_bridge.config.settings import Config, QoS
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)
from ros2_kafka_bridge.ros import second_channel
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.second_channel import unheard
from ros2_kafka_bridge.ros.topic_end import TopicEnd
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.route.memory import Kept
from ros2_kafka_bridge.threads.wakeup import Wakeup

IMAGE = 'sensor_msgs/msg/Image'
BYTES = Sequence(Primitive('uint8'))
CHUNK = Layout('p/msg/Chunk', (Field('data', BYTES),))


@pytest.fixture
def lyrical(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    on(monkeypatch, '10.0.10', 'rmw_fastrtps_cpp')
    return monkeypatch


def on(monkeypatch: pytest.MonkeyPatch, version: str, middleware: str) -> None:
    monkeypatch.setattr(second_channel, 'rclpy_version', lambda: version)
    monkeypatch.setattr(
        second_channel, 'is_fastdds', lambda: middleware.startswith('rmw_fastrtps')
    )


@pytest.mark.usefixtures('lyrical')
@pytest.mark.parametrize('kind', [BYTES, CHUNK, Array(CHUNK, 2), Sequence(CHUNK, 3)], ids=repr)
def test_a_type_with_unbounded_bytes_is_told_however_deep_they_lie(kind: Kind) -> None:
    assert unheard(Layout('p/msg/T', (Field('id', String()), Field('it', kind)))).startswith(
        'p/msg/T holds uint8[]: '
    )


@pytest.mark.usefixtures('lyrical')
@pytest.mark.parametrize(
    'kind',
    [
        Sequence(Primitive('uint8'), 100),
        Array(Primitive('uint8'), 100),
        Sequence(Primitive('int8')),
        Sequence(Primitive('byte')),
        Sequence(Primitive('bool')),
        Primitive('uint8'),
    ],
    ids=repr,
)
def test_what_has_no_buffer_in_cpp_is_not_told(kind: Kind) -> None:
    assert not unheard(Layout('p/msg/T', (Field('it', kind),)))


@pytest.mark.parametrize(
    ('version', 'is_told'), [('9.4.10', True), ('9.5.0', False), ('10.0.1', False), ('?', True)]
)
def test_who_has_the_cure_is_told_nothing(
    lyrical: pytest.MonkeyPatch, tmp_path: Path, version: str, *, is_told: bool
) -> None:
    share = tmp_path / 'share' / 'rmw_fastrtps_cpp'
    share.mkdir(parents=True)
    (share / 'package.xml').write_text(f'<package><version>{version}</version></package>')
    lyrical.setenv('AMENT_PREFIX_PATH', f'{tmp_path / "overlay"}:{tmp_path}')
    assert bool(unheard(CHUNK)) is is_told


@pytest.mark.parametrize(
    ('version', 'middleware', 'is_told'),
    [
        ('10.0.10', 'rmw_fastrtps_cpp', True),
        ('11.0.1', 'rmw_fastrtps_dynamic_cpp', True),
        ('10.0.10', 'rmw_cyclonedds_cpp', False),
        ('9.1.2', 'rmw_fastrtps_cpp', False),
        ('', 'rmw_fastrtps_cpp', False),
    ],
)
def test_only_lyrical_and_newer_on_fast_dds_have_that_channel(
    monkeypatch: pytest.MonkeyPatch, version: str, middleware: str, *, is_told: bool
) -> None:
    on(monkeypatch, version, middleware)
    assert bool(unheard(load_layout(IMAGE))) is is_told


@pytest.mark.usefixtures('lyrical')
def test_check_notes_it_of_a_route_with_such_a_type_alone() -> None:
    [finding] = check_ros.channel_findings(load_layout(IMAGE))
    assert (finding.level, finding.text) == ('note', unheard(load_layout(IMAGE)))
    assert [*check_ros.channel_findings(load_layout('std_msgs/msg/String'))] == []
    assert [*check_ros.channel_findings(None)] == []


@pytest.mark.usefixtures('lyrical')
def test_check_tells_it_with_all_else_of_the_route(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_ros, 'partial_view', lambda: None)
    ends = {'from': {'ros': '/camera', 'type': IMAGE}, 'to': {'kafka': 'camera'}}
    config = validated(
        Config,
        {
            'name': 'b',
            'kafka': {'bootstrap.servers': 'nowhere:1'},
            'routes': [{'name': 'r', 'format': 'cdr', **ends}],
        },
    )
    node = MagicMock(domain_id=0)
    node.publishers.return_value = []
    kafka = MagicMock(problem='away')
    met = report.Surroundings(config, node, kafka, '', {'r': Kept(67, None)})
    found = report._route_findings(config.routes[0], FoundType(IMAGE, load_layout(IMAGE)), met)
    assert unheard(load_layout(IMAGE)) in [finding.text for finding in found]


@pytest.mark.usefixtures('lyrical')
@pytest.mark.parametrize(('name', 'count'), [(IMAGE, 1), ('std_msgs/msg/String', 0)])
def test_a_route_from_ros_warns_at_its_start(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    monkeypatch.setattr(TopicReader, 'follow', lambda _: None)
    log = logging.LoggerAdapter(logging.getLogger('test'), {})
    with caplog.at_level(logging.WARNING):
        handle = MagicMock()
        handle.get_publishers_info_by_topic.return_value = []
        end = TopicEnd(still_node(handle), '/camera', load_type(name), QoS(), log)
        TopicReader(end, Arrivals(Wakeup())).open()
    assert [record.levelname for record in caplog.records] == ['WARNING'] * count
    assert caplog.text.count('sensor_msgs/msg/Image holds uint8[]: ') == count
