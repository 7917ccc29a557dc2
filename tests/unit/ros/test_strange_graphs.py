"""What strangers tell in the ROS graph, where rclpy cannot hand it over: guarantee 6b.

`tests/system/test_strange_graphs.py` has a stranger that does so, in DDS.
"""

import logging
from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from support.ros.ends import end_of, source_of, still_node

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros.control.node import Namesakes
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.types import MessageType
from ros2_kafka_bridge.ros.used_type import wait_for_type

LOG = logging.LoggerAdapter(logging.getLogger('ros2_kafka_bridge'), {})
TYPE = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)
NOT_UTF_8 = UnicodeDecodeError('utf-8', b'\xe9', 0, 1, 'unexpected end of data')
STRANGE = pytest.mark.parametrize(
    'error', [NOT_UTF_8, OverflowError('Total nanoseconds value is too large'), ValueError('a b')]
)


def publisher(gid: bytes, name: str = 'robot') -> Any:
    return SimpleNamespace(
        node_namespace='/', node_name=name, topic_type='p/msg/T', endpoint_gid=list(gid),
        topic_type_hash='', qos_profile=QoSProfile(
            depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
        ),
    )  # fmt: skip


@STRANGE
def test_what_rclpy_cannot_hand_over_is_an_error_of_the_bridge(error: Exception) -> None:
    handle = MagicMock()
    handle.get_publishers_info_by_topic.side_effect = error
    handle.get_subscriptions_info_by_topic.side_effect = error
    node = RosNode(handle, None)
    for look in (node.publishers, node.subscribers):
        with pytest.raises(RouteError, match=r'of /t: somebody in the ROS graph tells what canno'):
            look('/t')
    with pytest.raises(RouteError, match='tells what cannot be read'):
        wait_for_type(partial(node.publishers, '/t'), '/t', lambda _: True)
    handle.get_topic_names_and_types.side_effect = error
    with pytest.raises(RouteError, match='the topics of the ROS graph: somebody'):
        node.topics()


@STRANGE
def test_a_topic_that_cannot_be_told_of_hides_no_other(error: Exception) -> None:
    def publishers(topic: str) -> list[Any]:
        if topic == '/strange':
            raise error
        return [publisher(bytes(16))]

    handle = MagicMock()
    handle.get_fully_qualified_name.return_value = '/me'
    handle.get_topic_names_and_types.return_value = [('/strange', []), ('/good', [])]
    handle.get_publishers_info_by_topic.side_effect = publishers
    handle.get_subscriptions_info_by_topic.return_value = [publisher(b'a' * 16, 'reader')]
    good, strange = RosNode(handle, None).topics()
    assert (good.name, len(good.publishers), good.problem) == ('/good', 1, '')
    assert strange.problem.startswith('publishers of /strange: somebody in the ROS graph tells')
    assert [peer.node for peer in strange.subscribers] == ['/reader'], 'who can be read is known'


def test_a_topic_whose_name_is_none_of_ros_is_left_out() -> None:
    handle = MagicMock()
    handle.get_topic_names_and_types.return_value = [('/a b', [])]
    handle.get_publishers_info_by_topic.side_effect = InvalidTopicNameException('/a b', '', 2)
    assert RosNode(handle, None).topics() == []


@STRANGE
def test_who_was_there_is_taken_from_while_a_stranger_hides_the_others(
    error: Exception, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rcl, 'is_there', lambda: False)  # it would look into a mock
    handle = MagicMock()
    handle.get_publishers_info_by_topic.return_value = [publisher(b'a' * 16)]
    node = still_node(handle, handle.context)
    source = source_of(end_of(node, TYPE))
    source.open()
    handle.get_publishers_info_by_topic.side_effect = error
    gid = {'data': b'a' * 16}
    message = (b'cdr', {
        'publisher_gid': gid, 'publication_sequence_number': 1,
        'source_timestamp': 1,
    })  # fmt: skip
    taken = handle.create_subscription.return_value.handle.take_message
    taken.side_effect = [message, None]
    node.graph.look()
    assert [one.cdr for one in source.take(10, 0.0)] == [b'cdr']
    assert 'new publishers of /t are not followed' in caplog.text
    # One that nobody can tell of waits: its offer decides what else is to come of it.
    gid['data'] = b'b' * 16
    taken.side_effect = [message, None]
    for _ in range(2):
        with pytest.raises(RouteError, match='tells what cannot be read'):
            source.take(10, 0.0)
    handle.get_publishers_info_by_topic.side_effect = None
    handle.get_publishers_info_by_topic.return_value = [publisher(b'b' * 16)]
    taken.side_effect = [None, None]
    assert [one.cdr for one in source.take(10, 0.0)] == [b'cdr']


@STRANGE
def test_a_node_without_a_name_that_can_be_read_is_no_namesake(error: Exception) -> None:
    node = MagicMock()
    node.get_node_names_and_namespaces.side_effect = error
    Namesakes(node, LOG).look()
