"""What a contestant's node is started with, and how it tells its counter.

The paper's two nodes (`paper_kafka_ros`, `paper_ros_kafka`) are kept as they were printed
(Algorithms 1 and 2), to be compared with; use the bridge.
"""

import argparse
import os
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.route.counters import Counters, Outcome, to_line

_PERIOD_S: Final = 1.0


class NodeArguments(NamedTuple):
    """The command line of a node.

    Args:
        properties: For its Kafka client, by librdkafka's names.
        depth: Of its KEEP_LAST queue, in messages.
        snapshots: The descriptor of a pipe that gets its counter once a second.
        record: Where a node writes what `ros2-kafka-bridge depth` reads: the kafka-ros node its
            arrivals, the ros-kafka node its service times.
    """

    bootstrap_servers: str
    kafka_topic: str
    ros_topic: str
    properties: Mapping[str, str]
    depth: int
    snapshots: int | None
    record: Path | None


def arguments(description: str | None) -> NodeArguments:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('bootstrap_servers')
    parser.add_argument('kafka_topic')
    parser.add_argument('ros_topic')
    parser.add_argument(
        '-X', dest='properties', metavar='NAME=VALUE', action='append', default=[],
        help='a librdkafka property',
    )  # fmt: skip
    parser.add_argument('--depth', type=int, default=10, help='default: %(default)s')
    parser.add_argument('--record', type=Path, metavar='FILE', help='for the depth command')
    parser.add_argument('--snapshots', type=int, metavar='FD', help='a pipe for the counter')
    given = vars(parser.parse_args())
    properties = dict(text.split('=', 1) for text in given.pop('properties'))
    return NodeArguments(**given, properties=properties)


class Count:
    """How many messages a node has moved, told to its parent once a second.

    Args:
        route: The name it goes by.
        descriptor: Of the open pipe; None tells nobody.
    """

    def __init__(self, route: str, descriptor: int | None) -> None:
        self.confirmed = 0
        self._route = route
        self._descriptor = descriptor

    def start(self) -> None:
        """Begin to tell, from a thread that ends with the process."""
        if self._descriptor is not None:
            threading.Thread(target=self._keep_telling, name='snapshots', daemon=True).start()

    def tell(self) -> None:
        """Tell the number of now; a parent that is gone ends this process."""
        if self._descriptor is None:
            return
        counters = Counters(self._route, taken=self.confirmed)
        counters.end(Outcome.CONFIRMED, counters.taken)
        try:
            os.write(self._descriptor, to_line([counters.snapshot(in_flight=0)]))
        except BrokenPipeError:
            os._exit(1)

    def _keep_telling(self) -> None:
        while True:
            self.tell()
            time.sleep(_PERIOD_S)
