"""How a letter becomes again what it was on its way to be, checked before it is sent."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, TypeVar

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.letter import Explanation, Letter
from ros2_kafka_bridge.dead_letters.shown import escaped
from ros2_kafka_bridge.endpoints import HeaderList, Message, Outgoing, Record, headers_of
from ros2_kafka_bridge.errors import ConfigError, RecordError
from ros2_kafka_bridge.formats import Decode, Encode
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.route.format import check_of, decode_of, encode_of
from ros2_kafka_bridge.route.labels import MakeKey, make_key
from ros2_kafka_bridge.route.type_hash import CheckHeaders

_ORIGIN: Final = 'bridge.origin'
_FORCE: Final = '--force sends it as it is'

FetchOriginal = Callable[[str, int, int], Record | None]
"""Topic, partition, offset -> the record there, None where it is gone."""

SomeRoute = TypeVar('SomeRoute', KafkaToRosRoute, RosToKafkaRoute)


class Again(NamedTuple):
    """What is sent for a letter.

    Args:
        record: As it was, or is now.
        partition: Of the topic; None leaves it to the key.
        route: What carries it on; None where the file has none.
    """

    record: Outgoing
    partition: int | None
    route: AnyRoute | None


class Restorer:
    """Makes of letters what is sent.

    Args:
        config: With the routes as they are now.
        partitions: How many partitions each topic of the cluster has.
        fetch_original: Reads a record whose value the letter does not hold.
        force: Whether a record goes back to its topic though it would fail again.
    """

    def __init__(
        self,
        config: Config,
        partitions: Mapping[str, int],
        fetch_original: FetchOriginal,
        *,
        force: bool,
    ) -> None:
        self._config = config
        self._partitions = partitions
        self._fetch_original = fetch_original
        self._force = force
        self._decodes: dict[str, tuple[CheckHeaders, Decode]] = {}
        self._encodes: dict[tuple[str, str], tuple[CheckHeaders, Encode, MakeKey]] = {}

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
        letter = self._whole(letter, about)
        route = _chosen(
            [
                route
                for route in self._config.routes
                if isinstance(route, KafkaToRosRoute) and route.source.kafka == about.topic
            ],
            about,
        )
        if route is None and not self._force:
            text = f'no route of the file reads {escaped(about.topic)}: nothing can check it'
            raise RecordError(f'{text}; {_FORCE}')
        if route is not None:
            self._check(letter, route)
        headers = [header for header in letter.headers if not self._would_be_skipped(header)]
        record = Outgoing(about.topic, letter.key, letter.value, headers)
        known = self._partitions.get(about.topic, 0)
        same = about.partition if about.partition is not None and about.partition < known else None
        return Again(record, same, route)

    def _check(self, letter: Letter, route: KafkaToRosRoute) -> None:
        try:
            check_headers, decode = self._decode_of(route)
            check_headers(letter.headers)
            decode(letter.value)
        except RecordError as error:
            if not self._force:
                raise RecordError(f'would fail again: {type(error).__name__}: {error}') from error

    def _decode_of(self, route: KafkaToRosRoute) -> tuple[CheckHeaders, Decode]:
        if route.name not in self._decodes:
            layout = load_layout(route.sink.type, self._config.ros.message_path)
            decode = decode_of(route, self._config, layout)
            self._decodes[route.name] = check_of(route, layout), decode
        return self._decodes[route.name]

    def _would_be_skipped(self, header: tuple[str, str | bytes | None]) -> bool:
        return header in {(_ORIGIN, self._config.name), (_ORIGIN, self._config.name.encode())}

    def _whole(self, letter: Letter, about: Explanation) -> Letter:
        """The letter with its value, from its first topic where it was left out."""
        if about.value_bytes is None:
            return letter
        missing = f'its value ({about.value_bytes} bytes) was left out'
        original = None
        if about.partition is not None and about.offset is not None:
            original = self._fetch_original(about.topic, about.partition, about.offset)
        headers = [] if original is None else headers_of(original) or []
        if original is None or not _is_of(letter, about, original, headers):
            raise RecordError(f'{missing}, and {escaped(about.source)} is no longer there')
        return letter._replace(key=original.key(), value=original.value(), headers=headers)

    # ROS -> Kafka: encoded once more

    def _from_ros(self, letter: Letter, about: Explanation) -> Again:
        if about.value_bytes is not None:
            raise RecordError(
                f'its value ({about.value_bytes} bytes) was left out, and it came from ROS: '
                'nothing holds it any more'
            )
        route = _chosen(
            [
                route
                for route in self._config.routes
                if isinstance(route, RosToKafkaRoute)
                and (route.source.ros, route.sink.kafka) == (about.ros_topic, about.topic)
            ],
            about,
        )
        if route is None:
            ends = f'{escaped(about.ros_topic)} to {escaped(about.topic)}'
            raise RecordError(f'no route of the file goes from {ends}: nothing can encode it')
        key, value = letter.key, letter.value
        if about.reason.startswith('EncodeError:'):
            key, value = self._encoded(letter, route)
        record = Outgoing(about.topic, key, value, letter.headers)
        return Again(record, None, route)

    def _encoded(
        self, letter: Letter, route: RosToKafkaRoute
    ) -> tuple[bytes | None, bytes | None]:
        """Key and value of a message that could not be encoded before."""
        message = _message(letter)
        kind = _header(letter, 'ros.type').decode(errors='replace')
        name = route.source.type or kind
        if kind and name != kind:
            raise RecordError(f'it is of type {escaped(kind)}, the route carries {name} now')
        try:
            check_headers, encode, make_message_key = self._encode_of(route, name)
            check_headers(letter.headers)
            value = encode(message.cdr)
            return make_message_key(message), value
        except (RecordError, ConfigError) as error:
            text = f'{type(error).__name__}: {escaped(str(error))}'
            raise RecordError(f'would fail again: {text}') from error

    def _encode_of(
        self, route: RosToKafkaRoute, name: str
    ) -> tuple[CheckHeaders, Encode, MakeKey]:
        if (route.name, name) not in self._encodes:
            layout = load_layout(name, self._config.ros.message_path)
            self._encodes[route.name, name] = (
                check_of(route, layout),
                encode_of(route, self._config, layout),
                make_key(route.sink.key, route.source.ros, layout),
            )
        return self._encodes[route.name, name]


def _about(letter: Letter) -> Explanation:
    if letter.about is None:
        raise RecordError('it is no dead letter of a bridge')
    return letter.about


def _is_of(letter: Letter, about: Explanation, original: Record, headers: HeaderList) -> bool:
    """Whether a record is the one of the letter: a topic made anew has others there."""
    if len(original.value() or b'') != about.value_bytes:
        return False
    # One that was too large without its value, too, has left key and headers out.
    bare = letter.key is None and not letter.headers
    return bare or (letter.key, letter.headers) == (original.key(), headers)


def _chosen(routes: Sequence[SomeRoute], about: Explanation) -> SomeRoute | None:
    """The route of that name, or the only one between the same ends: it may have a new name."""
    named = [route for route in routes if route.name == about.route]
    if named or len(routes) == 1:
        return (named or routes)[0]
    return None


def _message(letter: Letter) -> Message:
    """The message of ROS that a letter holds, as far as its headers tell."""
    try:
        gid = bytes.fromhex(_header(letter, 'ros.gid').decode())
        seq = int(_header(letter, 'ros.seq') or 0)
        source_time_ns = int(_header(letter, 'ros.source_time_ns') or 0)
    except ValueError:
        gid, seq, source_time_ns = b'', 0, 0
    return Message(letter.value or b'', gid, seq, source_time_ns)


def _header(letter: Letter, name: str) -> bytes:
    value = dict(letter.headers).get(name)
    return value.encode() if isinstance(value, str) else value or b''
