"""The two ends of a route in ROS, at one topic of a node that a test has made."""

import logging
import threading
from typing import Any

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.graph import Graph
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.source import RosSource
from ros2_kafka_bridge.ros.topic_end import TopicEnd
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.topic_writer import TopicWriter
from ros2_kafka_bridge.ros.types import MessageType
from ros2_kafka_bridge.ros.writer_history import WriterHistory
from ros2_kafka_bridge.threads.wakeup import Wakeup

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


def still_graph() -> Graph:
    """A graph that tells of what has changed when a test calls its `look`, and never by itself."""
    graph = Graph(lambda: None)
    graph._thread = threading.Thread()  # which is not started
    return graph


def still_node(handle: Any, context: Any = None) -> RosNode:
    """A node with such a graph."""
    node = RosNode(handle, context)
    node.graph = still_graph()
    return node


def end_of(node: RosNode, message_type: MessageType, topic: str = '/t') -> TopicEnd:
    """What a route without QoS of its own has at a topic."""
    return TopicEnd(node, topic, message_type, QoS(), LOG)


def source_of(end: TopicEnd, **named: Any) -> RosSource:
    """Reads a topic; named arguments are those of a `TopicReader`."""
    arrivals = Arrivals(Wakeup())
    return RosSource(arrivals, {end.topic: TopicReader(end, arrivals, **named)})


def writer_of(
    end: TopicEnd, room: int = 5, *, asks: bool = True, bounded: bool = True
) -> TopicWriter:
    """Publishes on a topic, with a history of that room."""
    return TopicWriter(end, WriterHistory(room, asks=asks, bounded=bounded))
