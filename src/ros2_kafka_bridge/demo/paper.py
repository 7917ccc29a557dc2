"""What the two nodes of the paper are started with.

They are kept as they were printed (Algorithms 1 and 2), to be compared with; use the bridge.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

DEPTH: Final = 10


class PaperArguments(NamedTuple):
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


def arguments(description: str | None) -> PaperArguments:
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
    parser.add_argument('--depth', type=int, default=DEPTH, help='default: %(default)s')
    parser.add_argument('--record', type=Path, metavar='FILE', help='for the depth command')
    parser.add_argument('--snapshots', type=int, metavar='FD', help='a pipe for the counter')
    given = vars(parser.parse_args())
    properties = dict(text.split('=', 1) for text in given.pop('properties'))
    return PaperArguments(**given, properties=properties)
