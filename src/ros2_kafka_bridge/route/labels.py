"""What makes a record of a ROS message: its key and headers, beside the value of its format."""

from collections.abc import Callable
from typing import NamedTuple

from ros2_kafka_bridge.config.checks import KeyPart, key_parts
from ros2_kafka_bridge.endpoints import HeaderList, Message
from ros2_kafka_bridge.errors import BridgeError, EncodeError, error_of_bug
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.formats.walk import make_reader
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.route.identity import Author
from ros2_kafka_bridge.route.type_hash import CheckHeaders

MakeKey = Callable[[Message], bytes | None]
"""Message -> key of its record."""

MakeHeaders = Callable[[Message], HeaderList]
"""Message -> headers of its record."""


KEY_LIMIT_BYTES = 8192
"""The longest key that a message's own fields may make."""


class Conversion(NamedTuple):
    """What makes a record of a message.

    Args:
        make_encode: Makes, when the route runs for the first time, what makes a record's value
            from the CDR bytes of a message. It may raise a RouteError and be asked again: the
            source holds the publishers back meanwhile.
        make_key: Makes a record's key from a message that was encoded.
        make_headers: Makes a record's headers.
        check_headers: Refuses a message of another version of its type.
    """

    make_encode: Callable[[], Encode]
    make_key: MakeKey
    make_headers: MakeHeaders
    check_headers: CheckHeaders


def make_headers(
    author: Author, message_type: str, type_hash: Callable[[bytes], str | None]
) -> MakeHeaders:
    """Make the function that writes a record's headers.

    Args:
        author: Who makes the records.
        message_type: What is read from ROS.
        type_hash: REP-2011 hash of what the publisher with that gid sends, or empty; None while
            that publisher is not known.
    """
    by_publisher: dict[bytes, HeaderList] = {}

    def for_publisher(gid: bytes) -> HeaderList:
        known_hash = type_hash(gid)
        told = {
            'ros.type': message_type,
            'ros.type_hash': known_hash or '',
            'ros.gid': gid.hex(),
        }
        if len(by_publisher) > 1000:
            by_publisher.clear()
        same: HeaderList = [*author.headers]
        same += [(name, value.encode()) for name, value in told.items() if value]
        if known_hash is not None:
            by_publisher[gid] = same
        return same

    def headers(message: Message) -> HeaderList:
        _, gid, seq, made_ns = message
        made = [*(by_publisher.get(gid) or for_publisher(gid))]
        if seq:
            made.append(('ros.seq', b'%d' % seq))
        if made_ns > 0:  # some publishers send no time
            made.append(('ros.source_time_ns', b'%d' % made_ns))
        return made

    return headers


def make_key(template: str | None, topic: str, layout: Layout) -> MakeKey:
    """Make the function that writes a record's key.

    Args:
        template: Text with `{ros.topic}`, `{ros.gid}`, `{message.a.b}`; None is the ROS topic.
        topic: The ROS topic.
        layout: Of the message type.

    Returns:
        The function. It raises EncodeError for a key that is too long.

    Raises:
        ConfigError: The type has no such field.
    """
    parts = [_part(part, topic, layout) for part in key_parts(template or '{ros.topic}')]
    if all(isinstance(part, str) for part in parts):
        constant = ''.join(str(part) for part in parts).encode()
        return lambda _: constant

    def key(message: Message) -> bytes:
        try:
            made = ''.join(p if isinstance(p, str) else p(message) for p in parts).encode()
        except BridgeError:
            raise
        except Exception as bug:
            raise error_of_bug(EncodeError, bug) from bug
        if len(made) > KEY_LIMIT_BYTES:
            raise EncodeError(f'a key of {len(made)} bytes: at most {KEY_LIMIT_BYTES}')
        return made

    return key


def _part(part: KeyPart, topic: str, layout: Layout) -> str | Callable[[Message], str]:
    if part.kind == 'literal':
        return part.text
    if part.kind == 'ros.topic':
        return topic
    if part.kind == 'ros.gid':
        return lambda message: message.gid.hex()
    read = make_reader(layout, part.text)
    return lambda message: str(read(message.cdr))
