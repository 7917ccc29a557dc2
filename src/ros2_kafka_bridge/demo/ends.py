"""What the bridge of a demonstration joins, and its configuration."""

import json
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from ros2_kafka_bridge.testing.embedded_broker import QUICK_FETCH

_TYPE: Final = 'std_msgs/msg/String'


class DemoEnds(NamedTuple):
    """Kafka topic -> ROS topic -> Kafka topic.

    Args:
        name: Unique; everything that is made for the demonstration begins with it.
        is_embedded: Whether the broker ends with the demonstration.
    """

    name: str
    bootstrap_servers: str
    is_embedded: bool

    @property
    def source(self) -> str:
        """The Kafka topic with the orders."""
        return f'{self.name}.orders'

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
        return [f'{self.name}.kafka_to_ros', f'{self.sink}.demo']

    @property
    def consumer(self) -> Mapping[str, str]:
        """Properties of a Kafka consumer."""
        quick = QUICK_FETCH if self.is_embedded else {}
        return {'bootstrap.servers': self.bootstrap_servers, **quick}

    @property
    def config(self) -> str:
        """The configuration of the bridge between them; JSON is YAML."""
        ros = {'ros': '/' + self.name.replace('-', '_'), 'type': _TYPE}
        source, sink = {'kafka': self.source, 'start': 'earliest'}, {'kafka': self.sink}
        routes = [
            {'name': 'kafka_to_ros', 'from': source, 'to': ros, 'format': 'text'},
            {'name': 'ros_to_kafka', 'from': ros, 'to': sink, 'format': 'text'},
        ]
        return json.dumps({'name': self.name, 'kafka': self.consumer, 'routes': routes})
