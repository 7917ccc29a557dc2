"""Whether a record and its route mean the same message type, by the hash in its headers."""

from collections.abc import Callable

from ros2_kafka_bridge.config.settings import KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.errors import DecodeError, EncodeError, RecordError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.route.format import reads_fields

CheckHeaders = Callable[[HeaderList], None]
"""Headers of a record -> nothing, or a RecordError where the record is of another type."""

_TYPE, _HASH = 'ros.type', 'ros.type_hash'
_TOLD = b'RIHS'  # as every hash begins
_MOST_SHOWN = 300

_UNNAMED = frozenset({'cdr'})
"""Formats whose values do not tell what they hold: bytes of another type may look right."""


def check_nothing(_headers: HeaderList) -> None:
    """Let every record pass."""


def make_hash_check(name: str, type_hash: str | None, *, any_type: bool = False) -> CheckHeaders:
    """Make the function that refuses a record which was written with another type than this one.

    Args:
        name: Of the type that the route publishes.
        type_hash: Its REP-2011 hash; None, and nothing is refused.
        any_type: Whether the hash of a type with another name says nothing: a program that makes
            new records of others has copied it, and the format finds out itself what they hold.

    Returns:
        The function. It raises DecodeError where the headers tell another hash.
    """

    def refuse(written: str, there: str) -> DecodeError | None:
        if any_type and written not in {'', name}:
            return None
        told = (
            f'{_HASH}: the record was written with {written or "a type of hash"} {there}, this '
            f'route publishes {name} {type_hash}'
        )
        if written not in {'', name}:
            return DecodeError(
                f'{told}: it holds that type, or a program has copied the header from another '
                'record; let that leave ros.type_hash out, or set check_type_hash: false, and the '
                'format alone decides'
            )
        return DecodeError(
            f'{told}: install the same version of the package on both sides, or set '
            'check_type_hash: false, and the format alone decides'
        )

    return _make_check(type_hash, refuse)


def make_publisher_check(name: str, type_hash: str | None) -> CheckHeaders:
    """Make the function that refuses a message whose publisher has another version of the type.

    DDS may match types by their names alone. Bytes of the other version would be read into the
    wrong fields, mostly without an error.

    Args:
        name: Of the type that the route takes.
        type_hash: Its REP-2011 hash; None, and nothing is refused.

    Returns:
        The function from the headers of the message's record; it raises EncodeError.
    """

    def refuse(_written: str, there: str) -> EncodeError:
        return EncodeError(
            f'{_HASH}: the publisher sends {name} {there}, this route reads {type_hash}: the '
            'fields would be misread; start the bridge again, where a route without from.type '
            'takes what is published, install the same version of the package on both sides, or '
            'let the route carry format: cdr'
        )

    return _make_check(type_hash, refuse)


def _make_check(
    type_hash: str | None, refuse: Callable[[str, str], RecordError | None]
) -> CheckHeaders:
    if not type_hash:
        return check_nothing
    same = (_HASH, type_hash.encode())

    def check(headers: HeaderList) -> None:
        if same in headers:
            return
        told = dict(headers)
        there = _bytes(told.get(_HASH))
        if there.startswith(_TOLD) and there != same[1]:
            written = _bytes(told.get(_TYPE))
            error = refuse(_shown(written), _shown(there))
            if error is not None:
                raise error

    return check


def _shown(value: bytes) -> str:
    """What others have written, cut where no bridge writes as much."""
    return value[:_MOST_SHOWN].decode(errors='replace')


def _bytes(value: str | bytes | None) -> bytes:
    return value.encode() if isinstance(value, str) else value or b''


def check_record_of(route: KafkaToRosRoute, layout: Layout) -> CheckHeaders:
    """Make the function that refuses records of another version of the type."""
    if not route.check_type_hash:
        return check_nothing
    name, type_hash = layout.type_name, layout.type_hash
    return make_hash_check(name, type_hash, any_type=route.format not in _UNNAMED)


def check_message_of(route: RosToKafkaRoute, layout: Layout) -> CheckHeaders:
    """Make the function that refuses messages of another version of the type."""
    if not reads_fields(route):  # cdr reads no field into another: bytes and hash go on together
        return check_nothing
    return make_publisher_check(layout.type_name, layout.type_hash)
