"""What `check` finds at the broker: who answers, and what a route would meet there."""

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.kafka.cures import OWN_GROUP
from ros2_kafka_bridge.kafka.names import lock_group, lock_topic
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, TopicView, records
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.logs.text import count

_MEND_LISTENERS: Final = (
    'mend its advertised.listeners, or make that address known to this machine'
)


class CheckedCluster(NamedTuple):
    """The cluster as `check` asks it.

    Args:
        problem: Why it cannot be asked; empty if it answers.
        creates_topics: Whether it creates what is written to; None where it does not tell.
    """

    overview: Overview
    problem: str
    creates_topics: bool | None


def ask(config: Config) -> tuple[CheckedCluster, list[Finding]]:
    """Look who answers."""
    properties = common_properties(config.kafka, client_id=config.name)
    overview = Overview(properties)
    try:
        greeting = overview.greeting()
    except BridgeError as error:
        where = config.kafka.get('bootstrap.servers')
        away = isinstance(error, TransportError) and 'bootstrap.servers' not in str(error)
        cure = f'is bootstrap.servers ({where}) right, does the broker run?' if away else ''
        kafka = CheckedCluster(overview, str(error), None)
        return kafka, [Finding('bad', 'brokers', str(error), cure)]
    found = [Finding('bad', 'brokers', text, _MEND_LISTENERS) for text in greeting.unreached]
    if not greeting.brokers:
        problem = next(iter(greeting.unreached), 'the cluster names no broker of its own')
        return CheckedCluster(overview, problem, None), found
    kafka = CheckedCluster(overview, '', overview.creates_topics())
    return kafka, [Finding('ok', 'brokers', str(greeting)), *found]


def source_findings(
    route: KafkaToRosRoute, config: Config, kafka: CheckedCluster
) -> Iterator[Finding]:
    """What a route from Kafka would read, and from where on."""
    topic = route.source.kafka
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
    begins_anew = f'group {group} has no committed offsets (it is new, or they have expired)'
    held = KafkaTopic(topic, view.partitions, '')
    begins, ends = kafka.overview.begins([held]), kafka.overview.ends([held])
    if committed:
        places = {(topic, partition): offset for partition, offset in committed.items()}
        behind = records(held, {**begins, **places}, ends)
        told = '' if behind is None else f', {count(behind, "record")} to deliver'
        gone = sorted(place[1] for place, at in places.items() if at > ends.get(place, at))
        if gone:
            text = (
                f'group {group} is ahead of {topic}{gone}: it was made anew or cut off, and the '
                'bridge reads all that it holds now'
            )
            yield Finding('note', 'group', text)
        else:
            yield Finding('ok', 'group', f'group {group} goes on at its committed offsets{told}')
    elif route.source.start == 'earliest':
        size = records(held, begins, ends)
        told = '' if size is None else f' ({count(size, "record")})'
        text = f'{begins_anew}: start is earliest, all that the topic holds{told}'
        yield Finding('ok', 'group', text)
    else:
        yield Finding('ok', 'group', f'{begins_anew}: start is latest, only new ones')
    yield from _member_findings(group, config, kafka)


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
    topic = route.sink.kafka
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
        text += ': the broker creates it with its default settings'
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
