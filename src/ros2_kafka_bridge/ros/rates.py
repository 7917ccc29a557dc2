"""Counting the messages of topics for a while, without holding any publisher back."""

import contextlib
import logging
import time
from collections.abc import Mapping
from typing import Any

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.topic_end import TopicEnd
from ros2_kafka_bridge.ros.types import MessageType

_DEPTH = 1000
_STEP_S = 0.02


def count(node: RosNode, topics: Mapping[str, MessageType], seconds: float) -> dict[str, float]:
    """Count the messages of topics, as raw bytes.

    Best effort, volatile and KEEP_LAST: such a reader matches every publisher, and is one that
    no publisher waits for.

    Args:
        node: Makes the readers.
        topics: ROS topic -> its type.
        seconds: How long.

    Returns:
        Messages per second. A topic that cannot be subscribed to is left out.
    """
    log = logging.LoggerAdapter(logging.getLogger(__name__))
    made: list[tuple[TopicEnd, Any]] = []
    try:
        for topic, message_type in topics.items():
            end = TopicEnd(node, topic, message_type, QoS(), log)
            with contextlib.suppress(BridgeError):
                made.append((end, end.subscribe(_qos())))
        subscriptions = {end.topic: subscription for end, subscription in made}
        counts, measured_s = _count(subscriptions, seconds)
    finally:
        for end, subscription in made:
            end.unsubscribe(subscription)
    return {topic: count / measured_s for topic, count in counts.items()}


def _qos() -> Any:
    from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: PLC0415 (heavy)

    return QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)


def _count(subscriptions: Mapping[str, Any], seconds: float) -> tuple[dict[str, int], float]:
    from ros2_kafka_bridge.ros.take import take  # noqa: PLC0415 (heavy)

    counts = dict.fromkeys(subscriptions, 0)
    started_s = time.monotonic()
    while (left_s := started_s + seconds - time.monotonic()) > 0:
        time.sleep(min(left_s, _STEP_S))
        for topic, subscription in subscriptions.items():
            counts[topic] += len(take(subscription, _DEPTH)[0])
    return counts, time.monotonic() - started_s
