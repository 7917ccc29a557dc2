"""A cluster, its topics and how far they reach; nothing is read from them or changed."""

import contextlib
import socket
import time
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from operator import attrgetter
from typing import Any, Final, NamedTuple

from confluent_kafka import (
    Consumer,
    KafkaError,
    KafkaException,
    TopicCollection,
    TopicPartition,
)
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    ConfigResource,
    OffsetSpec,
    ResourceType,
)

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.kafka.errors import is_missing_topic, translate
from ros2_kafka_bridge.kafka.offsets import committed_of
from ros2_kafka_bridge.kafka.partition import Committed
from ros2_kafka_bridge.kafka.properties import consumer_properties
from ros2_kafka_bridge.kafka.topic_id import known_id
from ros2_kafka_bridge.logs.lines import client_log
from ros2_kafka_bridge.logs.text import count

_REQUEST_S: Final = 5.0
_LOOK_S: Final = 3.0
_MOST_LOOKS: Final = 16  # at a time
_COORDINATOR_S: Final = 15.0  # a Kafka that has begun just now makes its groups' topic first


class KafkaTopic(NamedTuple):
    """A topic of the cluster.

    Args:
        problem: Why nothing more is known of it, in the broker's words; empty if it is well.
    """

    name: str
    partitions: int
    problem: str


class TopicView(NamedTuple):
    """What is seen of a topic.

    Args:
        exists: Whether it is there; None where no broker has said so.
        rights: Operations that this user may do (READ, WRITE, ...); None if the broker does not
            tell.
        problem: Why it is not there, or is not known to be.
        topic_id: Which of all that ever had its name it is; empty if the broker does not tell.
    """

    exists: bool | None
    partitions: int
    rights: frozenset[str] | None
    problem: str
    topic_id: str = ''


class TopicState(NamedTuple):
    """A topic at this moment; its numbers are None where they are not known.

    Args:
        problem: Why nothing more is known of it, in the broker's words; empty if it is well.
        leaderless: Partitions that nobody leads: they take and give nothing.
        under_replicated: Partitions of which a replica is behind or away.
        is_there: None where the broker does not tell.
    """

    name: str
    partitions: int | None
    problem: str
    leaderless: int | None
    under_replicated: int | None
    is_there: bool | None


class ClusterState(NamedTuple):
    """A cluster at this moment.

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


class GroupMembers(NamedTuple):
    """Who is in a group.

    Args:
        strategy: How they share the partitions.
        clients: Their client.id.
    """

    strategy: str
    clients: frozenset[str]


class Greeting(NamedTuple):
    """Who answers of a cluster.

    Args:
        brokers: How many do, at the addresses that the cluster names.
        unreached: Why the others do not, each in a sentence: what answers at bootstrap.servers
            need not be a broker that can be reached.
    """

    cluster_id: str
    brokers: int
    unreached: list[str]

    def __str__(self) -> str:
        verb = 'answers' if self.brokers == 1 else 'answer'
        return f'{count(self.brokers, "broker")} of cluster {self.cluster_id} {verb}'


class Overview:
    """A cluster, looked at with the user's own properties, as often as one likes.

    Args:
        properties: librdkafka properties that all clients have.

    Raises:
        RouteError: A file that they name cannot be read.
    """

    def __init__(self, properties: Mapping[str, Any]) -> None:
        self._properties = properties
        self._admin = Admin(properties, __name__)
        self._coordinators_by_s: float | None = None

    def greeting(self) -> Greeting:
        """Look who answers.

        Raises:
            TransportError: Nobody does.
            RouteError: This user is not let in.
        """
        metadata = self._metadata()
        brokers = sorted(metadata.brokers.values(), key=attrgetter('id'))
        with ThreadPoolExecutor(_MOST_LOOKS) as looks:
            unreached = list(filter(None, looks.map(_unreached, brokers)))
        return Greeting(str(metadata.cluster_id), len(brokers) - len(unreached), unreached)

    def topics(self) -> list[KafkaTopic]:
        """All topics that this user may see, sorted; errors as of `greeting`."""
        return [
            KafkaTopic(name, len(topic.partitions), topic.error.str() if topic.error else '')
            for name, topic in sorted(self._metadata().topics.items())
        ]

    def topic(self, name: str) -> TopicView:
        """Look at one topic. Only a broker's own word says that it is not there."""
        try:
            answer = self._admin.requests.describe_topics(
                TopicCollection([name]),
                include_authorized_operations=True,
                request_timeout=_REQUEST_S,
            )[name].result()
        except KafkaException as error:
            return TopicView(_is_there(error), 0, None, str(error.args[0].str()))
        rights = answer.authorized_operations
        names = None if rights is None else frozenset(right.name for right in rights)
        return TopicView(
            exists=True,
            partitions=len(answer.partitions),
            rights=names,
            problem='',
            topic_id=known_id(answer.topic_id),
        )

    def look(self, topics: Collection[str]) -> ClusterState:
        """Ask for brokers and these topics: not for all that a cluster has, and creating none.

        Errors as of `greeting`.
        """
        began_s = time.monotonic()
        with self._admin.translated():
            asked = self._admin.requests.describe_cluster(request_timeout=_REQUEST_S)
            answers = self._ask_for(sorted(set(topics)))
            cluster = asked.result()
            states = [_state(name, answer) for name, answer in answers.items()]
        nodes = sorted(cluster.nodes, key=attrgetter('id'))
        return ClusterState(
            cluster_id=str(cluster.cluster_id),
            brokers={node.id: f'{node.host}:{node.port}' for node in nodes},
            controller=cluster.controller.id if cluster.controller else -1,
            round_trip_s=time.monotonic() - began_s,
            topics=states,
        )

    def begins(self, topics: Iterable[KafkaTopic]) -> dict[tuple[str, int], int]:
        """The first offset of each partition; those that do not answer are left out."""
        return self._offsets(topics, OffsetSpec.earliest())  # type: ignore[no-untyped-call]

    def ends(self, topics: Iterable[KafkaTopic]) -> dict[tuple[str, int], int]:
        """The offset behind the last record of each partition, as `begins`."""
        return self._offsets(topics, OffsetSpec.latest())  # type: ignore[no-untyped-call]

    def committed(self, group: str, topic: str, partitions: int) -> dict[int, Committed]:
        """Look up the committed offsets of a group, and which topic they are of.

        Raises:
            RouteError: This user may not see the group.
            TransportError: The coordinator does not answer.
        """
        asked = [TopicPartition(topic, number) for number in range(partitions)]
        # All groups together: a cluster that has no coordinator has none for the next one, either.
        if self._coordinators_by_s is None:
            self._coordinators_by_s = time.monotonic() + _COORDINATOR_S
        deadline_s = self._coordinators_by_s
        # A consumer asks, because librdkafka's admin request can end the process while the
        # coordinator of a broker that has just started loads its groups.
        properties = consumer_properties(self._properties, group=group, client_id=__name__)
        client = Consumer(properties, logger=client_log(__name__))
        with contextlib.closing(client):
            while True:
                try:
                    return committed_of(client.committed(asked, timeout=_REQUEST_S))
                except KafkaException as error:
                    problem = translate(error.args[0], 'its offsets cannot be read')
                    if not isinstance(problem, TransportError) or time.monotonic() > deadline_s:
                        raise problem from error
                    time.sleep(0.2)

    def members(self, group: str) -> GroupMembers:
        """Look who is in a group; nobody where that is not told.

        With a client of its own: one that lives on does not survive a late answer of a coordinator
        that has just begun (librdkafka, issue 4605).

        Raises:
            RouteError: It is no group of consumers.
        """
        requests = Admin(self._properties, __name__).requests
        try:
            asked = requests.describe_consumer_groups([group], request_timeout=_REQUEST_S)
            found = asked[group].result(_REQUEST_S + 1)
        except TimeoutError:
            return GroupMembers('', frozenset())
        except KafkaException as error:
            if error.args[0].code() == KafkaError._INVALID_ARG:  # noqa: SLF001 (its public name)
                raise RouteError(str(error.args[0].str())) from error
            return GroupMembers('', frozenset())
        clients = frozenset(str(member.client_id) for member in found.members)
        return GroupMembers(str(found.partition_assignor), clients)

    def creates_topics(self) -> bool | None:
        """Whether the brokers create a topic that is written to; None where they do not tell."""
        name = 'auto.create.topics.enable'
        try:
            brokers = self._admin.requests.list_topics(timeout=_REQUEST_S).brokers
            resource = ConfigResource(ResourceType.BROKER, str(min(brokers)))
            answer = self._admin.requests.describe_configs([resource], request_timeout=_REQUEST_S)
            value = answer[resource].result(_REQUEST_S + 1).get(name)
        except (KafkaException, TimeoutError, ValueError):
            return None
        return None if value is None else value.value == 'true'

    def _metadata(self) -> Any:
        with self._admin.translated():
            return self._admin.requests.list_topics(timeout=_REQUEST_S)

    def _ask_for(self, topics: list[str]) -> Mapping[str, Any]:
        if not topics:
            return {}
        wanted = TopicCollection(topics)
        return self._admin.requests.describe_topics(wanted, request_timeout=_REQUEST_S)

    def _offsets(
        self, topics: Iterable[KafkaTopic], spec: OffsetSpec
    ) -> dict[tuple[str, int], int]:
        asked = {
            TopicPartition(topic.name, number): spec
            for topic in topics
            for number in range(topic.partitions)
        }
        if not asked:
            return {}
        answers = self._admin.requests.list_offsets(asked, request_timeout=_REQUEST_S)
        found = {}
        for partition, answer in answers.items():
            try:
                offset = int(answer.result().offset)
            except KafkaException:
                continue  # its leader is away just now, or this user may not see it
            if offset >= 0:  # what could not ask the leader tells -1001
                found[partition.topic, partition.partition] = offset
        return found


def _unreached(broker: Any) -> str:
    """Why a broker cannot be reached; empty where it can."""
    try:
        socket.create_connection((broker.host, broker.port), _LOOK_S).close()
    except (OSError, UnicodeError) as error:  # a name that cannot be one of DNS, too
        reason = getattr(error, 'strerror', None) or str(error)
        return (
            f'the cluster names {broker.host}:{broker.port} as the address of broker {broker.id}, '
            f'and nobody answers there: {reason}'
        )
    return ''


def _state(name: str, answer: Any) -> TopicState:
    try:
        partitions = answer.result().partitions
    except KafkaException as error:
        return TopicState(name, None, _problem(error), None, None, _is_there(error))
    return TopicState(
        name=name,
        partitions=len(partitions),
        problem='',
        leaderless=sum(one.leader is None or one.leader.id < 0 for one in partitions),
        under_replicated=sum(len(one.isr) < len(one.replicas) for one in partitions),
        is_there=True,
    )


def _is_there(error: KafkaException) -> bool | None:
    """Whether a topic is there of which this was said; None where it does not tell."""
    return False if is_missing_topic(error.args[0]) else None


def _problem(error: KafkaException) -> str:
    """What the broker says of a topic.

    Raises:
        KafkaException: It is no word of a broker: none has answered.
    """
    found = error.args[0]
    if found.code() < 0:
        raise error
    if is_missing_topic(found):
        return 'it is not there, or this user may not see it'
    return str(found.str())


def records(
    topic: KafkaTopic,
    begins: Mapping[tuple[str, int], int],
    ends: Mapping[tuple[str, int], int],
) -> int | None:
    """How many offsets a topic holds: more than records where it is compacted or transactional.

    None where a partition did not answer, or none is known.
    """
    places = [(topic.name, number) for number in range(topic.partitions)]
    if not places or not all(place in begins and place in ends for place in places):
        return None
    return sum(ends[place] - begins[place] for place in places)
