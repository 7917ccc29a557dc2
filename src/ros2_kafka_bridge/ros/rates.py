"""Counting the messages of topics for a while, without holding any publisher back."""

import logging
import time
from collections.abc import Mapping
from typing import Any

from ros2_kafka_bridge.errors import BridgeError, blamed
from ros2_kafka_bridge.ros.errors import left_behind, translated
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.types import MessageType

_DEPTH = 1000
_BATCH = 200
_STEP_S = 0.1


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
    subscriptions: dict[str, Any] = {}
    try:
        for topic, message_type in topics.items():
            subscription = _subscribe(node, topic, message_type)
            if subscription is not None:
                subscriptions[topic] = subscription
        counts, measured_s = _count(node, subscriptions, seconds)
    finally:
        log = logging.LoggerAdapter(logging.getLogger(__name__))
        for topic, subscription in subscriptions.items():
            with left_behind(log, f'subscription of {topic}'), node.endpoint_lock:
                node.handle.destroy_subscription(subscription)
    return {topic: count / measured_s for topic, count in counts.items()}


def _subscribe(node: RosNode, topic: str, message_type: MessageType) -> Any:
    from rclpy.event_handler import SubscriptionEventCallbacks  # noqa: PLC0415 (heavy)
    from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: PLC0415

    try:
        with blamed(topic), translated(topic), node.endpoint_lock:
            return node.handle.create_subscription(
                message_type.endpoint_class,
                topic,
                lambda _: None,
                QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )
    except BridgeError:
        return None


def _count(
    node: RosNode, subscriptions: Mapping[str, Any], seconds: float
) -> tuple[dict[str, int], float]:
    from ros2_kafka_bridge.ros.take import Waiter, take  # noqa: PLC0415 (heavy)

    waiter = Waiter(node.context)
    counts = dict.fromkeys(subscriptions, 0)
    started_s = time.monotonic()
    while (left_s := started_s + seconds - time.monotonic()) > 0:
        if subscriptions:
            waiter.wait(list(subscriptions.values()), min(left_s, _STEP_S))
        else:
            time.sleep(left_s)
        for topic, subscription in subscriptions.items():
            counts[topic] += len(take(subscription, _BATCH)[0])
    return counts, time.monotonic() - started_s
