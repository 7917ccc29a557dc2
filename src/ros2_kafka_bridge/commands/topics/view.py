"""What was seen of both sides, as values: for the tables and for JSON."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class RouteRow:
    """A route at one of its topics, and what it does there."""

    route: str
    does: Literal['reads', 'writes', 'takes', 'publishes']


@dataclass(frozen=True)
class KafkaRow:
    """A Kafka topic.

    Args:
        partitions: How many; None where nothing more is known of it.
        records: Offsets that it holds; None where a partition does not answer.
        rate: Records a second; None where it was not asked for, or does not answer.
        kind: Whose it is, where it is not the user's own.
        routes: The routes that read or write it.
        problem: Why nothing more is known of it; empty if it is well.
    """

    name: str
    partitions: int | None
    records: int | None
    rate: float | None
    kind: Literal['', 'internal', 'dead letters']
    routes: list[RouteRow]
    problem: str


@dataclass(frozen=True)
class PeerRow:
    """Who publishes or subscribes."""

    node: str
    type: str
    reliability: str
    durability: str


@dataclass(frozen=True)
class Match:
    """Whether a route and a node of the graph would match.

    Args:
        problem: Why they would not; empty if nothing is known that keeps them from it.
        unknown: Why that is not known for certain; empty if it is.
    """

    route: str
    node: str
    problem: str
    unknown: str


@dataclass(frozen=True)
class RosRow:
    """A ROS topic.

    Args:
        type_origins: Of each type that is not installed here, where it is described.
        type_problems: Of each type that is described nowhere, why.
        rate: Messages a second; None where it was not asked for or could not be counted.
        kind: Whose it is, where it is not the user's own.
        routes: The routes that take from it or publish to it.
        matches: Each route with each node that it would meet.
        problem: Why not everybody there is known; empty if all are.
    """

    name: str
    types: list[str]
    type_origins: dict[str, str]
    type_problems: dict[str, str]
    publishers: list[PeerRow]
    subscribers: list[PeerRow]
    rate: float | None
    kind: Literal['', 'of ROS itself']
    routes: list[RouteRow]
    matches: list[Match]
    problem: str


@dataclass(frozen=True)
class Pair:
    """Two topics whose names correspond and that no route joins.

    Args:
        way: Where the messages would go, by who is there in ROS.
        problem: What would keep them from it as the bridge's own settings are.
    """

    kafka: str
    ros: str
    way: Literal['ROS to Kafka', 'Kafka to ROS']
    problem: str


@dataclass(frozen=True)
class TopicsView:
    """All that was seen.

    Args:
        brokers: The bootstrap servers.
        ros_domain: In words.
        kafka_problem: Why Kafka was not seen; empty if it was.
        ros_problem: Why the ROS graph was not.
        ros_hint: What to look for where not everybody there was; empty if all were.
        seconds: How long rates were measured; None where they were not asked for.
    """

    brokers: str
    kafka_problem: str
    ros_problem: str
    ros_hint: str
    ros_middleware: str
    ros_domain: str
    seconds: float | None
    kafka: list[KafkaRow]
    ros: list[RosRow]
    pairs: list[Pair]
