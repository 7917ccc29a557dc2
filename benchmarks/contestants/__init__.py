"""Who takes part in the benchmarks, and how each is started.

All get the same ends: `Ends` names the broker, the two Kafka topics and the ROS topic between
them. Everyone is two processes, one for each direction.
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

_HERE: Final = Path(__file__).parent

BRIDGE_FILE: Final = """\
name: drain
kafka:
  bootstrap.servers: {bootstrap_servers}
routes:
  - name: kafka_to_ros
    from: {{kafka: {source}, start: earliest}}
    to: {{ros: {ros_topic}, type: std_msgs/msg/String{qos}}}
    format: text
  - name: ros_to_kafka
    from: {{ros: {ros_topic}, type: std_msgs/msg/String{qos}}}
    to: {{kafka: {sink}}}
    format: text
"""


class Ends(NamedTuple):
    """What a contestant joins: Kafka topic -> ROS topic -> Kafka topic.

    Args:
        place: A directory of its own, for its files.
    """

    bootstrap_servers: str
    source: str
    ros_topic: str
    sink: str
    place: Path


class Commands(NamedTuple):
    """How the two processes are started.

    Args:
        subscribed: What `ros_to_kafka` prints when it has made its subscription.
    """

    kafka_to_ros: list[str]
    ros_to_kafka: list[str]
    subscribed: str


class Contestant(NamedTuple):
    """One way to move the orders."""

    what: str
    commands: Callable[[Ends], Commands]


def bridge(depth: int | None = None) -> Contestant:
    """This bridge, with default settings or with KEEP_LAST at both ends."""
    qos = '' if depth is None else f', qos: {{history: keep_last, depth: {depth}}}'

    def commands(ends: Ends) -> Commands:
        file = ends.place / 'bridge.yaml'
        file.write_text(BRIDGE_FILE.format(**ends._asdict(), qos=qos), encoding='utf-8')
        run = [sys.executable, '-m', 'ros2_kafka_bridge.worker', str(file), '--routes']
        return Commands([*run, 'kafka_to_ros'], [*run, 'ros_to_kafka'], 'subscribes to')

    words = 'default settings' if depth is None else f'KEEP_LAST {depth}'
    return Contestant(f'this bridge, {words}', commands)


def paper(depth: int, *of_ros_kafka: str) -> Contestant:
    """The two published algorithms; more options are those of its ros-kafka node."""
    module = 'ros2_kafka_bridge.demo.paper'
    options = ['--depth', str(depth)]
    return Contestant(
        f'the two published algorithms, depth {depth}',
        _both(
            ['-m', f'{module}_kafka_ros', *options],
            ['-m', f'{module}_ros_kafka', *options, *of_ros_kafka],
        ),
    )


def bare(*of_ros_kafka: str) -> Contestant:
    """Loops that move bytes and confirm nothing: the limit."""
    return Contestant(
        'loops that confirm nothing',
        _both(
            [str(_HERE / 'bare_kafka_ros.py')], [str(_HERE / 'bare_ros_kafka.py'), *of_ros_kafka]
        ),
    )


def _both(kafka_ros: list[str], ros_kafka: list[str]) -> Callable[[Ends], Commands]:
    def commands(ends: Ends) -> Commands:
        def node(program: list[str], kafka_topic: str) -> list[str]:
            return [sys.executable, *program, ends.bootstrap_servers, kafka_topic, ends.ros_topic]

        return Commands(node(kafka_ros, ends.source), node(ros_kafka, ends.sink), 'subscribed')

    return commands


CONTESTANTS: Final[Mapping[str, Contestant]] = MappingProxyType(
    {'paper': paper(10), 'bridge': bridge(), 'bare': bare()}
)
