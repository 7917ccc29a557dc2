"""A cluster at this moment, for whoever watches a bridge; nothing is changed."""

import time
from collections.abc import Collection, Mapping
from typing import Any, Final, NamedTuple

from confluent_kafka import KafkaError, KafkaException, TopicCollection

from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.logs.lines import client_log

_REQUEST_S: Final = 5.0


class TopicState(NamedTuple):
    """A topic.

    Args:
        problem: Why nothing more is known of it, in the broker's words; empty if it is well.
        leaderless: Partitions that nobody leads: they take and give nothing.
        under_replicated: Partitions of which a replica is behind or away.
    """

    name: str
    partitions: int
    problem: str
    leaderless: int
    under_replicated: int


class ClusterState(NamedTuple):
    """A cluster.

    Args:
        brokers: `host:port` of each that the cluster knows, by its id.
        controller: The id of the one that leads.
        round_trip_s: How long it took to ask.
        topics: Those that were asked for, sorted.
    """

    cluster_id: str
    brokers: dict[int, str]
    controller: int
    round_trip_s: float
    topics: list[TopicState]


class Cluster:
    """Looks at a cluster with the user's own properties, again and again.

    Args:
        properties: librdkafka properties that all clients have.

    Raises:
        RouteError: A file that they name cannot be read.
    """

    def __init__(self, properties: Mapping[str, Any]) -> None:
        client_log(__name__)  # the error says it
        self._admin = Admin(properties, __name__)

    def look(self, topics: Collection[str]) -> ClusterState:
        """Ask for brokers and these topics: not for all that a cluster has, and creating none.

        Raises:
            TransportError: No broker answers.
            RouteError: This user is not let in.
        """
        began_s = time.monotonic()
        with self._admin.translated('the broker does not answer'):
            asked = self._admin.requests.describe_cluster(request_timeout=_REQUEST_S)
            answers = self._ask_for(sorted(set(topics)))
            cluster = asked.result()
            states = [_state(name, answer) for name, answer in answers.items()]
        return ClusterState(
            cluster_id=str(cluster.cluster_id),
            brokers={n.id: f'{n.host}:{n.port}' for n in sorted(cluster.nodes, key=_number)},
            controller=cluster.controller.id if cluster.controller else -1,
            round_trip_s=time.monotonic() - began_s,
            topics=states,
        )

    def _ask_for(self, topics: list[str]) -> Mapping[str, Any]:
        if not topics:
            return {}
        wanted = TopicCollection(topics)
        return self._admin.requests.describe_topics(wanted, request_timeout=_REQUEST_S)


def _number(node: Any) -> int:
    return int(node.id)


def _state(name: str, answer: Any) -> TopicState:
    try:
        partitions = answer.result().partitions
    except KafkaException as error:
        return TopicState(name, 0, _problem(error), 0, 0)
    return TopicState(
        name=name,
        partitions=len(partitions),
        problem='',
        leaderless=sum(one.leader is None or one.leader.id < 0 for one in partitions),
        under_replicated=sum(len(one.isr) < len(one.replicas) for one in partitions),
    )


def _problem(error: KafkaException) -> str:
    """What the broker says of a topic.

    Raises:
        KafkaException: It is no word of a broker: none has answered.
    """
    found = error.args[0]
    if found.code() < 0:
        raise error
    if found.code() == KafkaError.UNKNOWN_TOPIC_OR_PART:
        return 'it is not there, or this user may not see it'
    return str(found.str())
