"""How a letter becomes again what it was on its way to be, checked before it is sent."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, TypeVar

from ros2_kafka_bridge.commands.dead_letters.types import LetterTypes
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.letter import Explanation, Letter
from ros2_kafka_bridge.dead_letters.shown import escaped
from ros2_kafka_bridge.dedup import place_in
from ros2_kafka_bridge.endpoints import (
    HeaderList,
    Message,
    Outgoing,
    Record,
    headers_of,
    source_time_ns,
)
from ros2_kafka_bridge.errors import ConfigError, RecordError
from ros2_kafka_bridge.formats import Decode, Encode
from ros2_kafka_bridge.kafka.letters import Original
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.route.format import decode_of, encode_of
from ros2_kafka_bridge.route.identity import make_loop_check
from ros2_kafka_bridge.route.labels import MakeKey, make_key
from ros2_kafka_bridge.route.type_hash import CheckHeaders, check_message_of, check_record_of

_FORCE: Final = '--force sends it as it is'
_NOT_THERE: Final = 'whose record is not in its topic now, or may not be read there'
_OTHER: Final = 'that are not the record which they tell of'
_OF_ROS: Final = 'that came from ROS'

FetchOriginal = Callable[[str, int, int], Original]
"""Topic, partition, offset -> what is there."""

SomeRoute = TypeVar('SomeRoute', KafkaToRosRoute, RosToKafkaRoute)


class Again(NamedTuple):
    """What is sent for a letter.

    Args:
        record: As it was, or is now.
        partition: Of the topic; None leaves it to the key.
        route: What carries it on; None where the file has none.
        unvouched: Why nothing but the letter shows that there was such a record or message; empty
            where the record that it tells of is still in its topic.
    """

    record: Outgoing
    partition: int | None
    route: AnyRoute | None
    unvouched: str


class Restorer:
    """Makes of letters what is sent.

    Args:
        config: With the routes as they are now.
        partitions: How many partitions each topic of the cluster has.
        fetch_original: Reads the record that a letter tells of.
        types: Of the letters.
        force: Whether a record goes back to its topic though it would fail again, or though its
            letter holds another one.
    """

    def __init__(
        self,
        config: Config,
        partitions: Mapping[str, int],
        fetch_original: FetchOriginal,
        types: LetterTypes,
        *,
        force: bool,
    ) -> None:
        self._config = config
        self._partitions = partitions
        self._fetch_original = fetch_original
        self._types = types
        self._force = force
        self._decodes: dict[str, tuple[CheckHeaders, Decode]] = {}
        self._of_types: dict[tuple[str, str, str | None], _OfType] = {}

    def for_kafka(self, letter: Letter) -> Again:
        """Make the record that goes to the topic which the letter names.

        Raises:
            RecordError: It cannot be sent, or would fail again: it stays a dead letter.
        """
        about = _about(letter)
        again = self._from_ros(letter, about) if about.ros_topic else self._checked(letter, about)
        topic = again.record.topic
        if topic == letter.place.topic:
            raise RecordError('it names its own dead-letter topic as the one that it came from')
        if topic not in self._partitions:
            text = f'the topic {escaped(topic)} is not there, or this user may not see it'
            raise RecordError(text)
        return again

    def for_ros(self, letter: Letter) -> Again:
        """Make the record whose message goes to the ROS topic of the letter's route.

        Raises:
            RecordError: It cannot be published: it stays a dead letter.
        """
        about = _about(letter)
        if about.ros_topic:
            raise RecordError('it came from ROS: it can be replayed to Kafka only')
        return self._checked(letter, about)

    # Kafka -> ROS: the record as it was

    def _checked(self, letter: Letter, about: Explanation) -> Again:
        readers = [it for it in self._config.to_ros if it.kafka_topic == about.topic]
        route = _chosen(readers, about)
        if route is None and not self._force:
            text = f'no route of the file reads {escaped(about.topic)}: nothing can check it'
            raise RecordError(f'{text}; {_FORCE}')
        letter, unvouched = self._whole(letter, about)
        if route is not None:
            self._check(letter, route)
        headers = self._without_loop(letter.headers, readers)
        record = Outgoing(about.topic, letter.key, letter.value, headers)
        known = self._partitions.get(about.topic, 0)
        same = about.partition if about.partition is not None and about.partition < known else None
        return Again(record, same, route, unvouched)

    def _check(self, letter: Letter, route: KafkaToRosRoute) -> None:
        try:
            check_headers, decode = self._decode_of(route)
            check_headers(letter.headers)
            decode(letter.value)
        except RecordError as error:
            if not self._force:
                raise RecordError(_again(error)) from error

    def _decode_of(self, route: KafkaToRosRoute) -> tuple[CheckHeaders, Decode]:
        if route.name not in self._decodes:
            layout = self._types.on_topic(route.ros_topic, route.type_name)
            decode = decode_of(route, self._config, layout)
            self._decodes[route.name] = check_record_of(route, layout), decode
        return self._decodes[route.name]

    def _without_loop(self, headers: HeaderList, readers: Sequence[KafkaToRosRoute]) -> HeaderList:
        """Leave the origin out where a route would refuse the record for it once more."""
        name = self._config.name
        if not any(make_loop_check(name, route.ros_topic)(headers) for route in readers):
            return headers
        return [header for header in headers if header != ('bridge.origin', name.encode())]

    def _whole(self, letter: Letter, about: Explanation) -> tuple[Letter, str]:
        """The letter with its value, from its first topic where it was left out.

        Returns:
            The letter, and why nothing vouches for it; empty where the same record is there.

        Raises:
            RecordError: That topic holds no such record, or another one.
        """
        assert about.partition is not None, 'it is of Kafka'
        assert about.offset is not None, 'it is of Kafka'
        original, was_there = self._fetch_original(about.topic, about.partition, about.offset)
        headers = [] if original is None else headers_of(original) or []
        if about.value_bytes is not None:
            if original is None or not _is_left_out(letter, about, original, headers):
                found = 'is gone, or may not be read' if original is None else 'is another record'
                raise RecordError(
                    f'its value ({about.value_bytes} bytes) was left out, and '
                    f'{escaped(about.source)} {found}'
                )
            whole = letter._replace(key=original.key(), value=original.value(), headers=headers)
            return whole, ''
        if original is None and was_there:
            return letter, _NOT_THERE
        if original is not None and _is_same(letter, original, headers):
            return letter, ''
        if not self._force:
            found = 'another record' if original is not None else 'a place that the topic has not'
            raise RecordError(
                f'{escaped(about.source)} is {found}: somebody else has written this letter, or '
                f'the topic was made anew; {_FORCE}'
            )
        return letter, _OTHER

    # ROS -> Kafka: encoded once more

    def _from_ros(self, letter: Letter, about: Explanation) -> Again:
        if about.value_bytes is not None:
            raise RecordError(
                f'its value ({about.value_bytes} bytes) was left out, and it came from ROS: '
                'nothing holds it any more'
            )
        ends = about.ros_topic, about.topic
        route = _chosen([it for it in self._config.to_kafka if it.topics == ends], about)
        if route is None:
            way = f'{escaped(about.ros_topic)} to {escaped(about.topic)}'
            raise RecordError(f'no route of the file goes from {way}: nothing can encode it')
        try:
            key, value = self._encoded(letter, about, route)
        except (RecordError, ConfigError) as error:
            raise RecordError(_again(error)) from error
        return Again(Outgoing(about.topic, key, value, letter.headers), None, route, _OF_ROS)

    def _encoded(
        self, letter: Letter, about: Explanation, route: RosToKafkaRoute
    ) -> tuple[bytes | None, bytes | None]:
        """Key and value of a message, encoded now where that was not possible before."""
        layout = self._types.of_message(route.ros_topic, _kind(letter, route), letter)
        of_type = self._of_type(route, layout)
        of_type.check_headers(letter.headers)
        if not about.reason.startswith('EncodeError:'):  # it was encoded, and refused by Kafka
            of_type.decode(letter.value)
            return letter.key, letter.value
        message = _message(letter)
        value = of_type.encode(message.cdr)
        return of_type.make_key(message), value

    def _of_type(self, route: RosToKafkaRoute, layout: Layout) -> '_OfType':
        place = route.name, layout.type_name, layout.type_hash
        if place not in self._of_types:
            self._of_types[place] = _OfType(
                check_message_of(route, layout),
                encode_of(route, self._config, layout),
                decode_of(route, self._config, layout),
                make_key(route.key, route.ros_topic, layout),
            )
        return self._of_types[place]


class _OfType(NamedTuple):
    """What a route from ROS does with the messages of a type."""

    check_headers: CheckHeaders
    encode: Encode
    decode: Decode
    make_key: MakeKey


def _about(letter: Letter) -> Explanation:
    if letter.about is None:
        raise RecordError('it is no dead letter of a bridge')
    return letter.about


def _is_left_out(
    letter: Letter, about: Explanation, original: Record, headers: HeaderList
) -> bool:
    """Whether a record is the one of a letter without value, and none of a topic made anew."""
    if len(original.value() or b'') != about.value_bytes:
        return False
    # One that was too large without its value, too, has left key and headers out.
    bare = letter.key is None and not letter.headers
    return bare or (letter.key, letter.headers) == (original.key(), headers)


def _is_same(letter: Letter, original: Record, headers: HeaderList) -> bool:
    """Whether a letter holds the record that it tells of; too many headers were left out."""
    if (letter.key, letter.value) != (original.key(), original.value()):
        return False
    return not letter.headers or letter.headers == headers


def _chosen(routes: Sequence[SomeRoute], about: Explanation) -> SomeRoute | None:
    """The route of that name, or the only one between the same ends: it may have a new name."""
    named = [route for route in routes if route.name == about.route]
    if named or len(routes) == 1:
        return (named or routes)[0]
    return None


def _again(error: RecordError | ConfigError) -> str:
    """What is said of a letter that cannot go on; of what no route has said, it is no again."""
    if type(error) is RecordError:
        return str(error)
    return f'would fail again: {type(error).__name__}: {error}'


def _message(letter: Letter) -> Message:
    """The message of ROS that a letter holds, as far as its headers tell."""
    gid, seq = place_in(letter.headers) or (b'', 0)
    return Message(letter.value or b'', gid, seq, source_time_ns(letter.headers))


def _kind(letter: Letter, route: RosToKafkaRoute) -> str:
    """The message type of a letter.

    Raises:
        RecordError: The route carries another one.
    """
    kind = letter.told('ros.type')
    name = route.type_name or kind
    if kind and name != kind:
        raise RecordError(f'it is of type {escaped(kind)}, the route carries {name} now')
    return name
