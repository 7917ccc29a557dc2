"""The settings of a route, and what every route tells of itself, whichever way it goes."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import Before, Settings, Values, look, setting, settings
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.endpoints import (
    FromKafka,
    FromRos,
    QoS,
    SpoolSettings,
    ToKafka,
    ToRos,
)
from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings
from ros2_kafka_bridge.config.mistakes import Mistake, field_names, kind_of, near
from ros2_kafka_bridge.config.values import (
    CheckField,
    CheckFormat,
    CountOrNone,
    Name,
    NotNegative,
    Positive,
    PositiveCount,
)
from ros2_kafka_bridge.kafka.names import reading_group

if TYPE_CHECKING:
    from pydantic import ValidationInfo

TEXT_TYPE = 'std_msgs/msg/String'
MOST_SAMPLES = 2000
"""How many messages DDS keeps for a route from ROS, however small they are."""

FORMAT_NAMES = ('text', 'cdr', 'json', 'avro', 'protobuf')
BLOCKS = {'json': ('json',), 'schema': ('avro', 'protobuf')}
"""The blocks of a route that belong to formats, with the formats that have them."""


@settings
class Route(Settings, ABC):
    """What all routes tell in one way, whichever way they go."""

    direction: ClassVar[Direction]

    name: Name = setting('Name of the route, unique in the file.')
    format: Literal['text', 'cdr', 'json', 'avro', 'protobuf'] = setting(
        f"How a record's value encodes a message: text ({TEXT_TYPE} only), or for "
        'any type cdr (as ROS sends it), json, avro or protobuf.'
    )
    json_settings: JsonSettings | None = setting(
        'How JSON is written and read (format: json).', default=None, spelled='json'
    )
    schema_settings: SchemaSettings | None = setting(
        'Where the schema comes from (format: avro and format: protobuf).',
        default=None,
        spelled='schema',
    )
    when_full: Literal['wait', 'drop_oldest'] = setting(
        'What happens when the sink takes no more. With wait, nothing is dropped.', default='wait'
    )
    on_error: Literal['dead_letter', 'stop', 'drop'] = setting(
        'What happens to a record or message that can never be delivered.', default='dead_letter'
    )
    max_in_flight: PositiveCount = setting(
        'Messages handed to the sink and not yet acknowledged, at most.', default=1
    )
    max_in_flight_bytes: PositiveCount = setting(
        'Bytes in flight (taken and not ended) at which nothing more is taken. With when_full: '
        'drop_oldest, so many may be with the sink, and as many more may wait for it.',
        default=16 * 1024 * 1024,
    )
    max_message_bytes: PositiveCount = setting(
        'Largest message, or value of a record, in bytes.', default=1_000_000
    )
    max_cache_bytes: PositiveCount = setting(
        'Bytes of messages that DDS keeps for the route: fewer messages where they are large. '
        'Counts where the type tells how large they are: with fields of fixed length, or with '
        'raw data such as images, of which each counts with max_message_bytes.',
        default=64 * 1024 * 1024,
    )
    drain_s: NotNegative = setting('Longest time for the drain at a stop, in seconds.', default=8)

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """The text format carries one type only, and a format has no use for another's block."""
        name = given.get('format')
        for side in ('from', 'to'):
            message_type = look(given, side, 'type')
            if name == 'text' and message_type not in (None, TEXT_TYPE):
                text = f'format: text carries {TEXT_TYPE} only: another type needs format: json'
                yield Mistake((side, 'type'), f'{text}, cdr, avro or protobuf')
        for block, formats in BLOCKS.items():
            if given.get(block) is not None and name in FORMAT_NAMES and name not in formats:
                has = ' and '.join(f'format: {one}' for one in formats)
                only = 'have' if len(formats) > 1 else 'has'
                yield Mistake((block,), f'only {has} {only} it, this is format: {name}')
        check: CheckFormat | None = context.get('check_format')
        if check and isinstance(name, str) and (problem := check(name)):
            yield Mistake(('format',), problem)

    @property
    @abstractmethod
    def _ends(self) -> tuple[FromKafka | ToKafka, FromRos | ToRos]:
        """Its end in Kafka, and its end in ROS."""

    @property
    def kafka_topic(self) -> str:
        """Its topic in Kafka."""
        return self._ends[0].kafka

    @property
    def ros_topic(self) -> str:
        """Its topic in ROS, by its absolute name."""
        return self._ends[1].ros

    @property
    def type_name(self) -> str | None:
        """Its message type; None where that is the one which is published."""
        return self._ends[1].type

    @property
    def qos(self) -> QoS:
        """What is said of the quality of service of its end in ROS."""
        return self._ends[1].qos

    @property
    def drops(self) -> bool:
        """Whether the oldest that wait are dropped where they are too much."""
        return self.when_full == 'drop_oldest'

    @property
    def has_fixed_history(self) -> bool:
        """Whether the file says how many messages DDS keeps for it, however large they are."""
        return self.qos.depth is not None

    def ros_history(self, message_bytes: int | None) -> int:
        """How many messages DDS keeps for it.

        Args:
            message_bytes: How large one may be; None where that is not known.
        """
        if message_bytes is None or self.has_fixed_history:
            return self._most_samples
        return max(1, min(self._most_samples, self.max_cache_bytes // message_bytes))

    @property
    @abstractmethod
    def _most_samples(self) -> int:
        """How many messages DDS keeps for it, however small they are."""

    @property
    def dead_letter_topic(self) -> str:
        """The Kafka topic for what can never be delivered."""
        return self._ends[0].dead_letter or self.kafka_topic + checks.DEAD_LETTER_SUFFIX


@settings
class KafkaToRosRoute(Route):
    """A route from Kafka to ROS."""

    direction: ClassVar[Literal[Direction.KAFKA_TO_ROS]] = Direction.KAFKA_TO_ROS
    key: ClassVar[None] = None
    spool: ClassVar[None] = None
    exclusive: ClassVar[Literal[False]] = False

    source: FromKafka = setting('Kafka topic to read.', spelled='from')
    sink: ToRos = setting('ROS topic to publish to.', spelled='to')
    max_in_flight: PositiveCount = setting(
        'Maximum number of messages published and not yet acknowledged. Messages '
        'that were read ahead, or acknowledged less than 0.1 s ago, are in flight, too. With '
        'when_full: drop_oldest, as many more may wait.',
        default=500,
    )
    min_subscribers: CountOrNone = setting(
        'Subscribers to wait for before publishing. With 0, the route publishes even '
        'if nobody is there.',
        default=1,
    )
    max_age_s: Positive | None = setting(
        'Age at which a record is dropped instead of published, in seconds. It '
        'counts from the timestamp of the record. If that cannot be right, the record is a dead '
        'letter.',
        default=None,
    )
    max_rate: Positive | None = setting(
        'Maximum messages per second, for readers with keep_last.', default=None
    )
    check_type_hash: bool = setting(
        'Whether a record is a dead letter if its header ros.type_hash is not the '
        'hash of the type here. If false, the format alone decides.',
        default=True,
    )
    skip_own: bool = setting(
        'Whether to skip a record that this bridge has made of a message of the same '
        'ROS topic. If false, the record is a dead letter, because it would go round in a '
        'circle.',
        default=False,
    )
    when_misread: Literal['wait', 'publish'] = setting(
        'What happens while a subscriber with another definition of the type would '
        'misread the messages. With wait, nothing is published.',
        default='wait',
    )

    def group(self, bridge: str) -> str:
        """The consumer group of this route in the bridge of that name."""
        return self.source.group or reading_group(bridge, self.name)

    @property
    def _ends(self) -> tuple[FromKafka, ToRos]:
        return self.source, self.sink

    @property
    def topics(self) -> tuple[str, str]:
        """The topic that it reads, and the one that it writes."""
        return self.kafka_topic, self.ros_topic

    @property
    def type_name(self) -> str:
        """Its message type."""
        return self.sink.type

    @property
    def _most_samples(self) -> int:
        return max(self.max_in_flight, self.qos.depth or 0)  # what is not acknowledged


@settings
class RosToKafkaRoute(Route):
    """A route from ROS to Kafka."""

    direction: ClassVar[Literal[Direction.ROS_TO_KAFKA]] = Direction.ROS_TO_KAFKA
    max_age_s: ClassVar[None] = None

    source: FromRos = setting('ROS topic to take from.', spelled='from')
    sink: ToKafka = setting('Kafka topic to write.', spelled='to')
    max_in_flight: PositiveCount = setting(
        'Maximum number of messages in flight (taken and not ended). With when_full: '
        'drop_oldest, so many may be with the producer, and as many more may wait for it.',
        default=2000,
    )
    spool: SpoolSettings | None = setting(
        'Where messages wait on disk while Kafka does not take them.', default=None
    )

    exclusive: bool = setting(
        'Whether several bridges run this file, and only one at a time runs this '
        'route. Another takes over when that one dies.',
        default=False,
    )

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """The key names fields that the type has, where the file says the type."""
        yield from super().mistakes(given, context)
        check: CheckField | None = context.get('check_field')
        key, message_type = look(given, 'to', 'key'), look(given, 'from', 'type')
        if check and isinstance(key, str) and isinstance(message_type, str):
            problems = [
                check(message_type, field, context.get('message_path', ()))
                for field in checks.key_fields(key)
            ]
            if told := '; '.join(dict.fromkeys(filter(None, problems))):
                yield Mistake(('to', 'key'), told)

    def group(self, bridge: str) -> None:
        """No consumer group: it reads nothing of Kafka."""

    @property
    def _ends(self) -> tuple[ToKafka, FromRos]:
        return self.sink, self.source

    @property
    def topics(self) -> tuple[str, str]:
        """The topic that it reads, and the one that it writes."""
        return self.ros_topic, self.kafka_topic

    @property
    def key(self) -> str | None:
        """Of what the key of its records is made; None is the ROS topic."""
        return self.sink.key

    @property
    def has_fixed_history(self) -> bool:
        """Whether the file says how many messages DDS keeps for it, however large they are."""
        return super().has_fixed_history or self.source.max_samples is not None

    @property
    def _most_samples(self) -> int:
        # With less room than its depth, a KEEP_LAST reader refuses the newest.
        return self.qos.depth or self.source.max_samples or MOST_SAMPLES


_ENDPOINTS: dict[tuple[str, str], type[Settings]] = {
    ('from', 'kafka'): FromKafka,
    ('from', 'ros'): FromRos,
    ('to', 'kafka'): ToKafka,
    ('to', 'ros'): ToRos,
}
_WORDS = {'kafka': 'Kafka', 'ros': 'ROS'}
_EXAMPLES = {'kafka': '{kafka: orders}', 'ros': '{ros: /orders}'}
_OTHER = {'kafka': 'ros', 'ros': 'kafka', 'from': 'to', 'to': 'from'}


def _kind(route: Values, side: str) -> str | None:
    """The kind of topic on one side of an unchecked route, None where that is not clear."""
    end = route.get(side)
    kinds = [kind for kind in _WORDS if kind in end] if isinstance(end, Mapping) else []
    return kinds[0] if len(kinds) == 1 else None


def model_of(route: Values) -> type[KafkaToRosRoute | RosToKafkaRoute]:
    """The settings class of an unchecked route, by its direction."""
    source = _kind(route, 'from') or _OTHER.get(_kind(route, 'to') or '', 'kafka')
    return KafkaToRosRoute if source == 'kafka' else RosToKafkaRoute


def _by_direction(value: Any, info: 'ValidationInfo') -> Any:
    if isinstance(value, Route):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f'expected a mapping, got {kind_of(value)}')  # noqa: TRY004  # pydantic's
    from ros2_kafka_bridge.config.validation import attempted, refused  # noqa: PLC0415 (heavy: only to read a file)

    model = model_of(value)
    found = [*_side_mistakes(value), *_misplaced(model, value)]
    known = {mistake.path for mistake in found}
    made, new = attempted(model, value, info.context)
    found += [m for m in new if m.path not in known and m.path[:1] not in known]
    if found:
        raise refused(model.__name__, found)
    return made


def _side_mistakes(route: Values) -> Iterator[Mistake]:
    """What keeps a route from having one topic in Kafka and one in ROS."""
    for side in ('from', 'to'):
        end, other = route.get(side), _kind(route, _OTHER[side])
        right = _EXAMPLES[_OTHER[other]] if other else ' or '.join(_EXAMPLES.values())
        if end is None:
            yield Mistake((side,), f'is missing: a topic such as {right}')
        elif not isinstance(end, Mapping):
            yield Mistake((side,), f'expected a mapping such as {right}, got {kind_of(end)}')
        elif all(kind in end for kind in _WORDS):
            yield Mistake((side,), 'names both a kafka and a ros topic: a side is one of them')
        elif _kind(route, side) is None:
            hint = next((found for word in end for found in [near(word, _WORDS)] if found), '')
            yield Mistake((side,), f'names no topic, such as {right}{hint}')
    if (kind := _kind(route, 'from')) and kind == _kind(route, 'to'):
        text = f'both sides are {_WORDS[kind]}: a route joins Kafka and ROS, such as '
        yield Mistake(('to',), text + _EXAMPLES[_OTHER[kind]])


_PYTHONS = {
    'source': 'from', 'sink': 'to', 'json_settings': 'json', 'schema_settings': 'schema',
}  # fmt: skip


def _misplaced(model: type[Settings], route: Values) -> Iterator[Mistake]:
    """Fields that exist, but not for this direction or side, and Python's names in a file."""
    for name, right in _PYTHONS.items():
        if name in route:
            yield Mistake((name,), f"unknown field '{name}' (did you mean '{right}'?)")
    words = ('ROS to Kafka', 'Kafka to ROS')[:: 1 if model is RosToKafkaRoute else -1]
    other = KafkaToRosRoute if model is RosToKafkaRoute else RosToKafkaRoute
    for name in route.keys() & (field_names(other).keys() - field_names(model).keys()):
        text = f'only a route from {words[1]} has it, this one goes from {words[0]}'
        yield Mistake((name,), text)
    for side in ('from', 'to'):
        kind = _kind(route, side)
        for name in route[side] if kind else ():
            yield from _misplaced_in_end(side, kind or '', name)


def _misplaced_in_end(side: str, kind: str, name: str) -> Iterator[Mistake]:
    if name in field_names(_ENDPOINTS[side, kind]):
        return
    for (right_side, right_kind), model in _ENDPOINTS.items():
        if name in field_names(model):
            where = f"only a {_WORDS[right_kind]} topic in '{right_side}' has it"
            yield Mistake((side, name), f"{where}, this is a {_WORDS[kind]} topic in '{side}'")
            return


AnyRoute = Annotated[KafkaToRosRoute | RosToKafkaRoute, Before(_by_direction)]
