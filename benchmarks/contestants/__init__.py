"""Who takes part in the drain, and how each is started.

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
    to: {{ros: {ros_topic}, type: std_msgs/msg/String}}
    format: text
  - name: ros_to_kafka
    from: {{ros: {ros_topic}, type: std_msgs/msg/String}}
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


def _bridge(ends: Ends) -> Commands:
    file = ends.place / 'bridge.yaml'
    file.write_text(BRIDGE_FILE.format(**ends._asdict()), encoding='utf-8')
    run = [sys.executable, '-m', 'ros2_kafka_bridge', 'run', str(file), '--routes']
    return Commands([*run, 'kafka_to_ros'], [*run, 'ros_to_kafka'], 'subscribes to')


def _both(kafka_ros: list[str], ros_kafka: list[str]) -> Callable[[Ends], Commands]:
    def commands(ends: Ends) -> Commands:
        def node(program: list[str], kafka_topic: str) -> list[str]:
            return [sys.executable, *program, ends.bootstrap_servers, kafka_topic, ends.ros_topic]

        return Commands(node(kafka_ros, ends.source), node(ros_kafka, ends.sink), 'subscribed')

    return commands


_PAPER: Final = 'ros2_kafka_bridge.demo.paper'
_paper = _both(['-m', f'{_PAPER}_kafka_ros'], ['-m', f'{_PAPER}_ros_kafka'])
_bare = _both([str(_HERE / 'bare_kafka_ros.py')], [str(_HERE / 'bare_ros_kafka.py')])

CONTESTANTS: Final[Mapping[str, Contestant]] = MappingProxyType(
    {
        'paper': Contestant('the two published algorithms, depth 10', _paper),
        'bridge': Contestant('this bridge, default settings', _bridge),
        'bare': Contestant('loops that confirm and count nothing', _bare),
    }
)
