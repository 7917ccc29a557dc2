"""What `check` finds at the broker: who answers, and what a route would meet there."""

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.kafka.cause import NO_ANSWER
from ros2_kafka_bridge.kafka.cures import OWN_GROUP
from ros2_kafka_bridge.kafka.names import lock_group, lock_topic
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, TopicView, records
from ros2_kafka_bridge.kafka.partition import Committed
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.kafka.topic_id import TopicId
from ros2_kafka_bridge.kafka.topic_partitions import in_words
from ros2_kafka_bridge.logs.text import count

_NONE_COMMITTED: Final = (
    'has no committed offsets (it is new, they have expired, or went with a topic that was '
    'deleted)'
)
_SET_OFFSETS: Final = (
    'where they do not fit, set others while the bridge is stopped (kafka-consumer-groups.sh '
    '--reset-offsets)'
)
_MEND_LISTENERS: Final = (
    'mend its advertised.listeners, or make that address known to this machine'
)


class CheckedCluster(NamedTuple):
    """The cluster as `check` asks it.

    Args:
        problem: Why it cannot be asked; empty if it answers.
        creates_topics: Whether it creates what is written to; None where it does not tell.
        cluster_id: Which one it is; empty if it does not answer.
    """

    overview: Overview
    problem: str
    creates_topics: bool | None
    cluster_id: str


class _Reach(NamedTuple):
    """A topic that a group would read, and how far it reaches.

    Args:
        begins: The first offset of each partition that tells it.
        ends: The offset behind the last record, as `begins`.
    """

    group: str
    topic: KafkaTopic
    begins: Mapping[tuple[str, int], int]
    ends: Mapping[tuple[str, int], int]

    def ahead(self, offsets: Mapping[int, int]) -> set[int]:
        """Partitions that end before their offset."""
        name = self.topic.name
        return {number for number, at in offsets.items() if at > self.ends.get((name, number), at)}

    def behind(self, offsets: Mapping[int, int]) -> int | None:
        """How many records are left from these offsets on; all of a partition without one."""
        places = {(self.topic.name, number): at for number, at in offsets.items()}
        there = {place: max(at, self.begins.get(place, at)) for place, at in places.items()}
        return records(self.topic, {**self.begins, **there}, self.ends)


def ask(config: Config) -> tuple[CheckedCluster, list[Finding]]:
    """Look who answers."""
    properties = common_properties(config.kafka, client_id=config.name)
    overview = Overview(properties)
    try:
        greeting = overview.greeting()
    except BridgeError as error:
        where = config.kafka.get('bootstrap.servers')
        away = str(error).startswith(NO_ANSWER) and 'bootstrap.servers' not in str(error)
        cure = f'is bootstrap.servers ({where}) right, does the broker run?' if away else ''
        kafka = CheckedCluster(overview, str(error), None, '')
        return kafka, [Finding('bad', 'brokers', str(error), cure)]
    found = [Finding('bad', 'brokers', text, _MEND_LISTENERS) for text in greeting.unreached]
    if not greeting.brokers:
        problem = next(iter(greeting.unreached), 'the cluster names no broker of its own')
        return CheckedCluster(overview, problem, None, greeting.cluster_id), found
    kafka = CheckedCluster(overview, '', overview.creates_topics(), greeting.cluster_id)
    return kafka, [Finding('ok', 'brokers', str(greeting)), *found]


def source_findings(
    route: KafkaToRosRoute, config: Config, kafka: CheckedCluster
) -> Iterator[Finding]:
    """What a route from Kafka would read, and from where on."""
    topic = route.kafka_topic
    view = kafka.overview.topic(topic)
    yield _topic_finding('source', topic, view, 'READ')
    if not view.exists:
        return
    group = route.group(config.name)
    try:
        committed = kafka.overview.committed(group, topic, view.partitions)
    except BridgeError as error:
        yield _unseen_group('group', group, error)
        return
    held = KafkaTopic(topic, view.partitions, '')
    reach = _Reach(group, held, kafka.overview.begins([held]), kafka.overview.ends([held]))
    if committed:
        now = TopicId(kafka.cluster_id, view.topic_id) if view.topic_id else None
        yield from _committed_findings(reach, committed, now)
    else:
        yield _first_start(reach, route.source.start)
    yield from _member_findings(group, config, kafka)


def _committed_findings(
    reach: _Reach, committed: Mapping[int, Committed], now: TopicId | None
) -> list[Finding]:
    """Where a group goes on that has offsets, as the bridge does (kafka/topic_watch.py).

    Args:
        reach: Of the topic that is there.
        committed: What the group has got.
        now: Which topic is there; None where that is not told.
    """
    group, topic = reach.group, reach.topic.name
    gone = {n for n, it in committed.items() if now is not None and now.has_replaced(it.of)}
    offsets = {n: it.offset for n, it in committed.items() if n not in gone}
    ahead = reach.ahead(offsets)
    kept = {n: at for n, at in offsets.items() if n not in ahead}
    size = reach.behind(kept)
    told = '' if size is None else f', {count(size, "record")} to deliver'
    texts = []
    if gone:
        texts.append(
            f'the offsets of group {group} at {in_words(topic, gone)} are of a topic of this name '
            f'that is gone: the bridge reads all that is there now{told}'
        )
    if ahead:
        texts.append(
            f'group {group} is ahead of {in_words(topic, ahead)}: it was made anew or cut off, '
            f'and the bridge reads all that it holds now{told}'
        )
    found = [Finding('note', 'group', text) for text in texts]
    foreign = {n: of for n in kept if (of := committed[n].of) and now and now.is_elsewhere(of)}
    if now and foreign:
        found.append(_foreign_finding(reach, foreign, now, told))
    return found or [
        Finding('ok', 'group', f'group {group} goes on at its committed offsets{told}')
    ]


def _foreign_finding(
    reach: _Reach, foreign: Mapping[int, TopicId], now: TopicId, told: str
) -> Finding:
    """What becomes of offsets of another cluster."""
    clusters = ', '.join(sorted({of.cluster_id for of in foreign.values()}))
    where = in_words(reach.topic.name, foreign)
    text = (
        f'the offsets of group {reach.group} at {where} are of cluster {clusters}, and this is '
        f'cluster {now.cluster_id}: the bridge goes on at them{told}'
    )
    return Finding('note', 'group', text, _SET_OFFSETS)


def _first_start(reach: _Reach, start: str) -> Finding:
    """Where a group begins that has none."""
    text = f'group {reach.group} {_NONE_COMMITTED}: start is {start}, '
    if start != 'earliest':
        return Finding('ok', 'group', f'{text}only new ones')
    size = reach.behind({})
    told = '' if size is None else f' ({count(size, "record")})'
    return Finding('ok', 'group', f'{text}all that the topic holds{told}')


def _member_findings(group: str, config: Config, kafka: CheckedCluster) -> Iterator[Finding]:
    """Who is in the group that is not of this bridge.

    A note: which ways to share partitions they would agree to is not told.
    """
    try:
        members = kafka.overview.members(group)
    except BridgeError as error:
        yield Finding('bad', 'group', str(error), OWN_GROUP)
        return
    own = str(config.kafka.get('client.id', config.name))
    is_own = re.compile(rf'{re.escape(own)}(-worker-\d+)?').fullmatch
    others = sorted(name for name in members.clients if not is_own(name))
    if not others:
        return
    text = (
        f'group {group} has members of another application ({", ".join(others)}), which share its '
        f'partitions by {members.strategy or "a way that is not known yet"}: this bridge gets a '
        'part of the records, or is not let in'
    )
    yield Finding('note', 'group', text, OWN_GROUP)


def sink_findings(route: RosToKafkaRoute, kafka: CheckedCluster) -> Iterator[Finding]:
    """What a route to Kafka would write to."""
    topic = route.kafka_topic
    view = kafka.overview.topic(topic)
    if view.exists is False:
        yield _missing_sink(topic, kafka.creates_topics)
        return
    yield _topic_finding('sink', topic, view, 'WRITE')
    if view.rights is not None and 'READ' not in view.rights:
        text = (
            f'no READ on topic {topic}: needed for TRANSIENT_LOCAL publishers, to skip '
            'what is there from before a restart'
        )
        yield Finding('note', 'sink', text)


def lock_findings(
    route: RosToKafkaRoute, config: Config, kafka: CheckedCluster
) -> Iterator[Finding]:
    """What bridges that take turns would agree by."""
    if not route.exclusive:
        return
    topic, group = lock_topic(config.name), lock_group(config.name, route.name)
    view = kafka.overview.topic(topic)
    if view.exists is False:
        text = f'lock topic {topic} is not there: it is created at the start, if this user may'
        yield Finding('note', 'lock', text)
        return
    if view.exists and view.partitions != 1:
        text = f'lock topic {topic} has {view.partitions} partitions, and must have one'
        yield Finding('bad', 'lock', text, 'delete it, and create it with one')
        return
    yield _topic_finding('lock', topic, view, 'READ')
    if not view.exists:
        return
    try:
        kafka.overview.committed(group, topic, view.partitions)
    except BridgeError as error:
        yield _unseen_group('lock', group, error)


def _unseen_group(thing: str, group: str, error: BridgeError) -> Finding:
    cure = 'add the ACL READ on the group'
    if isinstance(error, TransportError):
        cure = (
            'check once more if Kafka has begun just now; no group works where the topic '
            '__consumer_offsets is to have more copies than there are brokers'
        )
    return Finding('bad', thing, f'group {group}: {error}', cure)


def _missing_sink(topic: str, creates_topics: bool | None) -> Finding:  # noqa: FBT001 (unknown, too)
    text = f'topic {topic} is not there'
    if creates_topics is None:
        text += ': the route fails unless the broker creates topics by itself'
        return Finding('note', 'sink', text, 'create it')
    if creates_topics:
        text += ': the broker creates it with its default settings, if this user may'
        return Finding('note', 'sink', text, 'create it for partitions and copies of your choice')
    return Finding('bad', 'sink', f'{text}, and the broker creates none by itself', 'create it')


def _topic_finding(thing: str, topic: str, view: TopicView, right: str) -> Finding:
    if view.exists is None:
        text = f'whether topic {topic} is there is not known: {view.problem}'
        return Finding('bad', thing, text, f'check once more, with {right} on the topic')
    if not view.exists:
        return Finding('bad', thing, f'topic {topic} is not there ({view.problem})', 'create it')
    if view.rights is not None and right not in view.rights:
        return Finding('bad', thing, f'this user has no {right} on topic {topic}', 'add the ACL')
    return Finding('ok', thing, f'topic {topic} has {count(view.partitions, "partition")}')


def dead_letter_findings(route: AnyRoute, kafka: CheckedCluster) -> Iterator[Finding]:
    """Where the bad records of a route would go."""
    if route.on_error != 'dead_letter':
        text = f'on_error: {route.on_error}: bad records are not kept'
        yield Finding('note', 'dead letters', text)
        return
    topic = route.dead_letter_topic
    view = kafka.overview.topic(topic)
    if view.exists is not False:
        found = _topic_finding('dead letters', topic, view, 'WRITE')
        # Without the right to see it the route runs, until there is a bad record.
        yield found if view.exists else found._replace(level='note')
    else:
        text = (
            f'dead-letter topic {topic} is not there: it is created at the '
            'first dead letter, if this user may'
        )
        yield Finding('note', 'dead letters', text)
