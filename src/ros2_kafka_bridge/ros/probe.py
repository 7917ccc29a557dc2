"""What the middleware of this process does, found by trying it once at start.

The guarantees rest on behaviour that no API tells: a KEEP_ALL history of n samples takes n and
then refuses, a full one blocks for a millisecond, a raw take brings the publisher and a number.
A profile that was not read or another middleware shows here, and not as a loss.
"""

import os
import time
from typing import Any, NamedTuple

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import load_type

SAMPLES = 4
"""Length of the probe's history and of its reader's cache, for the profile."""

MESSAGE = b'\x00\x01\x00\x00' + bytes(8)
"""A `builtin_interfaces/msg/Time` as CDR."""

_ANSWER_S = 5.0
_PATIENCE_S = 0.03
_PREFIX_BYTES = 12  # of a GUID: its participant; four more tell the endpoint (RTPS 2.5, 9.3.1)


class Abilities(NamedTuple):
    """What the middleware does.

    Args:
        bounded: A full history refuses, as the profile says; else confirmation waits for pauses.
        gid: A message tells its publisher.
        seq: A message tells its number at its publisher.
        own: What the gids of all endpoints of this process begin with; empty where none is told.
        denies: It has said of a full history that not all is acknowledged; else that it tells the
            truth has to be shown otherwise.
        by_rcl: rcl itself tells the same of a message as rclpy.
    """

    bounded: bool
    gid: bool
    seq: bool
    own: bytes
    denies: bool
    by_rcl: bool = False


def probe_topic() -> str:
    """Make a name that no other process uses; the profile must know it before the start."""
    return f'/_ros2_kafka_bridge/probe_{os.getpid()}_{time.monotonic_ns():x}'


def probe(node: RosNode, topic: str) -> Abilities:
    """Try the middleware on a private topic with one writer and one reader.

    Raises:
        ConfigError: rclpy does not have the calls that the bridge takes messages with.
    """
    time_class = load_type('builtin_interfaces/msg/Time', 'import').endpoint_class
    with translated('ROS'):
        publisher = node.handle.create_publisher(time_class, topic, profile(QoS()))
        subscription = node.handle.create_subscription(
            time_class, topic, lambda _: None, profile(QoS()), raw=True
        )
    try:
        with translated('ROS'):
            return _try(publisher, subscription)
    except (AttributeError, TypeError, KeyError) as error:
        raise ConfigError(
            [f'this rclpy does not take messages the way the bridge needs: {error!r}']
        ) from error
    finally:
        node.handle.destroy_subscription(subscription)
        node.handle.destroy_publisher(publisher)


def _try(publisher: Any, subscription: Any) -> Abilities:
    from ros2_kafka_bridge.ros.take import (  # noqa: PLC0415 (heavy)
        MatchEvents,
        is_told_by_rcl,
        take,
    )

    events = MatchEvents(publisher)
    deadline_s = time.monotonic() + _ANSWER_S
    while not events.look()[0] and time.monotonic() < deadline_s:
        time.sleep(0.002)
    accepted = sum(_accepts(publisher) for _ in range(3 * SAMPLES))
    bounded = SAMPLES <= accepted <= 2 * SAMPLES
    denied = bounded and denies(publisher)  # the reader has refused all that is in there
    deadline_s = time.monotonic() + _ANSWER_S
    while not (taken := take(subscription, 1)[0]) and time.monotonic() < deadline_s:
        time.sleep(0.002)
    events.close()
    info = taken[0][1] if taken else {}
    return Abilities(
        bounded=bounded,
        gid='publisher_gid' in info,
        seq=bool(info.get('publication_sequence_number')),
        own=bytes(info['publisher_gid']['data'])[:_PREFIX_BYTES]
        if 'publisher_gid' in info
        else b'',
        denies=denied,
        by_rcl=bool(taken) and is_told_by_rcl(subscription, taken[0]),
    )


def denies(publisher: Any) -> bool:
    """Whether the middleware says that not all is acknowledged which was published."""
    from rclpy.duration import Duration  # noqa: PLC0415 (heavy)
    from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415

    try:
        return not publisher.wait_for_all_acked(Duration())
    except rclpy_implementation.RCLError:
        return False  # one that cannot be asked tells nothing


def _accepts(publisher: Any) -> bool:
    from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415

    deadline_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            with publisher.handle:
                publisher.handle.publish_raw(MESSAGE)
        except rclpy_implementation.RCLError:
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.001)
        else:
            return True


def limits(abilities: Abilities) -> list[str]:
    """Say which guarantees the middleware does not carry."""
    said = []
    if not abilities.bounded:
        said.append(
            'this middleware does not bound a KEEP_ALL history: a slow subscriber may take memory '
            'or hold up all routes of a process (guarantee 4), and routes to ROS publish no more '
            'than max_in_flight messages until all are acknowledged'
        )
    if not abilities.gid or not abilities.seq:
        said.append(
            'this ROS does not tell the publisher or the number of a message: headers ros.gid '
            'and ros.seq are left out, gaps upstream are not seen, and publishers of different '
            'QoS are read with the weakest (guarantees 2 and 8)'
        )
    return said
