"""Names of topics on both sides: which correspond, and which one follows from another."""

import re

from ros2_kafka_bridge.config.checks import DEAD_LETTER_SUFFIX, KAFKA_NAME_LIMIT

_OF_ROS_ITSELF = frozenset({'/clock', '/parameter_events', '/rosout'})


def stem(topic: str) -> str:
    """What corresponding topics of both sides share: `/robot1/odom` and `robot1.odom`.

    Kafka itself takes `.` and `_` for the same, and refuses a second topic that differs in it.
    """
    return re.sub(r'[^a-z0-9]+', '.', topic.lower()).strip('.')


def is_of_ros_itself(topic: str) -> bool:
    """Whether ROS uses the topic for itself: logs, parameters, time, services and actions."""
    hidden = any(word.startswith('_') for word in topic.split('/'))
    return hidden or topic in _OF_ROS_ITSELF


def is_of_kafka_itself(topic: str) -> bool:
    """Whether the brokers use the topic for themselves."""
    return topic.startswith('__')


def kafka_name(ros_topic: str) -> str:
    """The Kafka topic that is named after a ROS topic: `robot1.odom` for `/robot1/odom`.

    It leaves room for the name of its dead-letter topic.
    """
    name = ros_topic.strip('/').replace('/', '.')
    return name[: KAFKA_NAME_LIMIT - len(DEAD_LETTER_SUFFIX)]


def route_name(ros_topic: str) -> str:
    """The route that is named after a ROS topic: `robot1_odom` for `/robot1/odom`."""
    return ros_topic.strip('/').replace('/', '_')


def unique(name: str, taken: set[str]) -> str:
    """The name, with a number behind it where another one that Kafka takes for it is there.

    Args:
        name: The one wanted.
        taken: Names that are there, with `.` for `_`; the new one is added.
    """
    found, number = name, 1
    while found.replace('_', '.') in taken:
        number += 1
        end = f'-{number}'
        room = KAFKA_NAME_LIMIT - len(DEAD_LETTER_SUFFIX) - len(end)
        found = name[:room] + end
    taken.add(found.replace('_', '.'))
    return found
