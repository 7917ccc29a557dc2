"""Who can carry the orders, and how each is started."""

import sys
from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Final, NamedTuple

from ruamel.yaml import YAML

from ros2_kafka_bridge.demo.paper import DEPTH


class Ends(NamedTuple):
    """What a contestant joins: Kafka topic -> ROS topic -> Kafka topic.

    Args:
        name: Unique; everything that is made for the contestant begins with it.
        properties: For its Kafka consumer, by librdkafka's names.
        place: A directory of its own, for its files.
    """

    name: str
    bootstrap_servers: str
    properties: Mapping[str, str]
    place: Path

    @property
    def source(self) -> str:
        """The Kafka topic with the orders."""
        return f'{self.name}.orders'

    @property
    def ros_topic(self) -> str:
        """The ROS topic between the two."""
        return '/' + self.name.replace('-', '_')

    @property
    def sink(self) -> str:
        """The Kafka topic of those that came back."""
        return f'{self.name}.returned'

    @property
    def dead_letters(self) -> Sequence[str]:
        """Kafka topics that only something unexpected makes."""
        return [f'{self.source}.dead-letters', f'{self.sink}.dead-letters']

    @property
    def groups(self) -> Sequence[str]:
        """Consumer groups that may be left at the broker."""
        return [f'{self.name}.kafka_to_ros', f'{self.source}.paper', f'{self.sink}.demo']


class Program(NamedTuple):
    """A process to start; `--snapshots FD` is added to its command."""

    name: str
    command: Sequence[str]


class Contestant(NamedTuple):
    """One way to carry the orders.

    Args:
        title: Of its column.
        programs: Makes its processes, for the ends given.
    """

    name: str
    title: str
    programs: Callable[[Ends], Sequence[Program]]


def _bridge(ends: Ends) -> Sequence[Program]:
    message_type = 'std_msgs/msg/String'
    config = {
        'name': ends.name,
        'kafka': {'bootstrap.servers': ends.bootstrap_servers, **ends.properties},
        'routes': [
            {
                'name': 'kafka_to_ros',
                'from': {'kafka': ends.source, 'start': 'earliest'},
                'to': {'ros': ends.ros_topic, 'type': message_type},
                'format': 'text',
            },
            {
                'name': 'ros_to_kafka',
                'from': {'ros': ends.ros_topic, 'type': message_type},
                'to': {'kafka': ends.sink},
                'format': 'text',
            },
        ],
    }
    text = StringIO()
    YAML(typ='safe').dump(config, text)
    file = ends.place / 'bridge.yaml'
    file.write_text(text.getvalue(), encoding='utf-8')
    return [
        Program('the bridge', [sys.executable, '-m', 'ros2_kafka_bridge.process.start', str(file)])
    ]


def _paper(ends: Ends) -> Sequence[Program]:
    def program(node: str, kafka_topic: str, *options: str) -> Program:
        command = [
            sys.executable, '-m', f'ros2_kafka_bridge.demo.paper_{node}',
            ends.bootstrap_servers, kafka_topic, ends.ros_topic, '--depth', str(DEPTH), *options,
        ]  # fmt: skip
        return Program(f"the paper's {node.replace('_', '-')} node", command)

    properties = [f'-X{name}={value}' for name, value in ends.properties.items()]
    return [
        program('ros_kafka', ends.sink),
        program('kafka_ros', ends.source, *properties),
    ]


BRIDGE: Final = Contestant('bridge', 'this bridge', _bridge)
PAPER: Final = Contestant('paper', f'the paper, depth {DEPTH}', _paper)
