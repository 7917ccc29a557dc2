"""What the command line of `depth` asks for."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Kafka(NamedTuple):
    """A Kafka topic whose records are the arrivals.

    Args:
        topic: Its name.
        servers: Brokers; empty where `config` names them.
        partition: This one alone; None for all.
        last: How many records.
        config: A bridge's configuration, for its `kafka` section.
        properties: `name=value`, over those of the configuration.
    """

    topic: str
    servers: str
    partition: int | None
    last: int
    config: Path | None
    properties: Sequence[str]


class Ros(NamedTuple):
    """A live ROS topic, and for how many seconds it is watched."""

    topic: str
    seconds: float


class DepthOptions(NamedTuple):
    """What the command line asks for; what was not given is None or empty.

    Args:
        kafka: Arrivals of a Kafka topic.
        ros: Arrivals of a ROS topic, live.
        arrivals: A file of arrivals.
        recording: A file of arrivals and service times.
        service: A service time for all, as `0.8ms`.
        service_file: A file of service times.
        wake: How long an idle reader takes to begin, as `0.2ms`.
        loss: Share of the messages that may be lost.
        depths: Where the loss is shown, too.
        plot: Where to draw.
        as_json: For programs instead of people.
    """

    kafka: Kafka | None
    ros: Ros | None
    arrivals: Path | None
    recording: Path | None
    service: str
    service_file: Path | None
    wake: str
    loss: float
    depths: Sequence[int]
    plot: Path | None
    as_json: bool
