"""The settings of both ends of a route."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

from annotated_types import MinLen

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import Settings, Values, setting, settings
from ros2_kafka_bridge.config.mistakes import Mistake
from ros2_kafka_bridge.config.values import (
    Directory,
    Domain,
    KafkaTopicName,
    KeyTemplate,
    MessageFolder,
    MessageTypeName,
    Positive,
    PositiveCount,
    Properties,
    RosTopic,
)
from ros2_kafka_bridge.kafka.properties import is_consumers


@settings
class QoS(Settings):
    """Quality of service of the bridge's own ROS endpoint; the bridge chooses what is left out."""

    reliability: Literal['reliable', 'best_effort'] | None = setting(
        'Whether a lost message is sent again. The bridge chooses reliable.', default=None
    )
    durability: Literal['volatile', 'transient_local'] | None = setting(
        'Whether a late reader gets what was published before.', default=None
    )
    history: Literal['keep_all', 'keep_last'] | None = setting(
        'Whether a full history waits (keep_all) or overwrites (keep_last). The '
        'bridge chooses keep_all.',
        default=None,
    )
    depth: PositiveCount | None = setting('How many messages keep_last keeps.', default=None)
    deadline_s: Positive | None = setting(
        'Longest time between two messages, in seconds.', default=None
    )
    lifespan_s: Positive | None = setting(
        'Age at which a message is no longer delivered, in seconds.', default=None
    )
    liveliness: Literal['automatic', 'manual_by_topic'] | None = setting(
        'How a writer shows that it is alive.', default=None
    )

    @classmethod
    def mistakes(cls, given: Values, _context: Values, /) -> Iterator[Mistake]:
        """A depth belongs to keep_last, and only to it."""
        keeps_last, depth = given.get('history') == 'keep_last', given.get('depth')
        if keeps_last and depth is None:
            yield Mistake(('history',), 'keep_last needs a depth, such as depth: 10')
        if depth is not None and not keeps_last:
            yield Mistake(('depth',), 'only history: keep_last has a depth')


Packages = Literal['as_needed', 'import']


@settings
class RosSettings(Settings):
    """How the bridge joins the ROS graph."""

    domain_id: Domain | None = setting(
        'ROS domain, 0 to 232. Without it, ROS_DOMAIN_ID counts.', default=None
    )
    lease_s: Positive | None = setting(
        'Time after which others take this bridge for gone if they hear nothing of '
        "it, in seconds. Without it, the middleware's own.",
        default=None,
    )
    confirmation: Literal['acknowledged', 'none'] = setting(
        'When a message to ROS counts as arrived. acknowledged: once its readers '
        'have acknowledged it; if the middleware does not tell, routes to ROS fail. none: nobody '
        'asks, and offsets follow the publication. What is lost from there on stays lost. '
        'Messages count as published, not as confirmed.',
        default='acknowledged',
    )
    packages: Packages = setting(
        'What is done with the Python packages of message types. as_needed: where '
        'the middleware takes a type by its description, none is imported. import: each is.',
        default='as_needed',
    )
    message_path: list[MessageFolder] = setting(
        'Folders of .msg files, relative to this file, for message types that are '
        'not installed here, or in another version. They come before what is installed. Where '
        'packages are imported, a route that runs needs the installed one.',
        default_factory=list,
    )


def _dead_letter_mistakes(given: Values) -> Iterator[Mistake]:
    topic, dead_letter = given.get('kafka'), given.get('dead_letter')
    if dead_letter is not None and dead_letter == topic:
        yield Mistake(('dead_letter',), 'is the topic of the route itself: give it another one')
    room = checks.KAFKA_NAME_LIMIT - len(checks.DEAD_LETTER_SUFFIX)
    if dead_letter is None and isinstance(topic, str) and room < len(topic):
        text = f'is missing: {checks.DEAD_LETTER_SUFFIX} does not fit behind so long a topic name'
        yield Mistake(('dead_letter',), text)


@settings
class FromKafka(Settings):
    """A Kafka topic that a route reads."""

    kafka: KafkaTopicName = setting('Kafka topic.')
    start: Literal['latest', 'earliest'] = setting(
        'Where to begin in a partition without a committed offset.', default='latest'
    )
    group: Annotated[str, MinLen(1)] | None = setting(
        'Consumer group. Without it, `<name of the bridge>.<name of the route>`.', default=None
    )
    dead_letter: KafkaTopicName | None = setting(
        'Kafka topic for records that can never be delivered. Without it, `<topic>.dead-letters`.',
        default=None,
    )

    @classmethod
    def mistakes(cls, given: Values, _context: Values, /) -> Iterator[Mistake]:
        """A topic is not its own dead-letter topic."""
        yield from _dead_letter_mistakes(given)


@settings
class ToKafka(Settings):
    """A Kafka topic that a route writes."""

    kafka: KafkaTopicName = setting('Kafka topic.')
    key: KeyTemplate | None = setting(
        'Key of each record: text with `{ros.topic}`, `{ros.gid}` or '
        '`{message.a.b}`. Without it, the key is the ROS topic, so that one topic stays in order '
        'in one partition.',
        default=None,
    )
    properties: Properties = setting(
        'librdkafka properties for this route only, by their own names.', default_factory=dict
    )
    dead_letter: KafkaTopicName | None = setting(
        'Kafka topic for messages that can never be delivered. Without it, '
        '`<topic>.dead-letters`.',
        default=None,
    )

    @classmethod
    def mistakes(cls, given: Values, _context: Values, /) -> Iterator[Mistake]:
        """A sink has no use for a consumer's property, and is not its own dead-letter topic."""
        yield from _dead_letter_mistakes(given)
        properties = given.get('properties')
        for name in properties if isinstance(properties, Mapping) else ():
            if is_consumers(str(name)):
                yield Mistake(('properties', str(name)), "a consumer's property: a sink has none")


@settings
class SpoolSettings(Settings):
    """Where messages wait on disk while Kafka does not take them."""

    path: Directory = setting(
        'Directory, by its absolute path. It is created if it is missing. Each route '
        'has its own file there.'
    )
    mode: Literal['when_away', 'always'] = setting(
        'when_away: the disk is used while Kafka is away or does not keep up. '
        'always: every message is on disk before it goes on, and leaves the disk once it is '
        'confirmed.',
        default='when_away',
    )
    max_bytes: PositiveCount = setting(
        'Bytes of messages at which the file is full; when_full says what happens '
        'then. What was taken by then (a batch of 500, the window) is still written.',
        default=1024 * 1024 * 1024,
    )
    max_age_s: Positive | None = setting(
        'Age at which a message on disk is dropped, in seconds.', default=None
    )
    sync: Literal['batch', 'never'] = setting(
        'batch: each write waits until the disk confirms it. never: what is written '
        'survives SIGKILL, but the system decides when it reaches the disk.',
        default='batch',
    )


@settings
class FromRos(Settings):
    """A ROS topic that a route takes from."""

    ros: RosTopic = setting('ROS topic, by its absolute name such as /orders.')
    type: MessageTypeName | None = setting(
        'Message type. Without it, the type that the graph shows.', default=None
    )
    qos: QoS = setting("Quality of service of the bridge's reader.", default_factory=QoS)
    max_samples: PositiveCount | None = setting(
        'Maximum number of messages that DDS keeps for the bridge while it does not '
        'take them, for each QoS that publishers offer. Without it, as many as fit into '
        'max_cache_bytes, at most 2,000. With history: keep_last, its depth counts.',
        default=None,
    )


@settings
class ToRos(Settings):
    """A ROS topic that a route publishes to."""

    ros: RosTopic = setting('ROS topic, by its absolute name such as /orders.')
    type: MessageTypeName = setting('Message type, such as std_msgs/msg/String.')
    qos: QoS = setting("Quality of service of the bridge's writer.", default_factory=QoS)
