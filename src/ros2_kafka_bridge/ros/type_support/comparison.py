"""Whether an installed type tells what a made one does, field by field of their structures."""

import ctypes
from collections.abc import Iterator
from typing import Any, Final

from ros2_kafka_bridge.errors import BridgeError, blamed
from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.ros.type_support import descriptions
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class
from ros2_kafka_bridge.ros.type_support.loaded import (
    FASTDDS,
    INTROSPECTION,
    message_class,
    support_of,
)
from ros2_kafka_bridge.ros.type_support.structures import (
    Description,
    FastddsType,
    IntrospectedType,
    TypeHash,
    TypeSupport,
)

# rclpy has imported them by now; between them they have every kind of list, and what they hold.
_KNOWN: Final = ('rcl_interfaces/msg/ParameterEvent', 'rcl_interfaces/msg/ParameterDescriptor')
_READ: Final = ('name', 'type_id', 'string_bound', 'is_key', 'is_list', 'length', 'is_bounded')


def difference() -> str:
    """What types that rclpy uses tell otherwise than made ones; empty where it is the same.

    Structures that are not those of the table may end the process.
    """
    try:
        with blamed('the types of rclpy cannot be read'):
            return next(filter(None, map(_difference, _KNOWN)), '')
    except BridgeError as error:
        return str(error)


def told_by(one: Any) -> dict[str, object]:
    """Read all that a class tells rclpy of its type: each thing by its place."""
    return {
        **_of_support('type', support_of(one)),
        **_of_fastdds(support_of(one, FASTDDS)),
        **dict(_of_members(INTROSPECTION, support_of(one, INTROSPECTION))),
    }


def _difference(name: str) -> str:
    here = told_by(message_class(name))
    made = told_by(endpoint_class(name, describe(name).types))
    for place in {**here, **made}:
        if here.get(place) != made.get(place):
            return f'{name}: {place} is {here.get(place)!r}, expected was {made.get(place)!r}'
    return ''


def _of_support(place: str, support: TypeSupport) -> dict[str, object]:
    address = ctypes.addressof(support)
    hashed = TypeHash.from_address(support.get_hash(address))
    described = Description.from_address(support.get_description(address))
    return {
        f'{place}: hash': (hashed.version, bytes(hashed.value).hex()),
        f'{place}: description': descriptions.read(described),
    }


def _of_fastdds(support: TypeSupport) -> dict[str, object]:
    fastdds = FastddsType.from_address(support.data)
    return {
        **_of_support(FASTDDS, support),
        f'{FASTDDS}: identifier': support.identifier,
        f'{FASTDDS}: namespace': fastdds.namespace,
        f'{FASTDDS}: name': fastdds.name,
        f'{FASTDDS}: has a key': fastdds.key is not None,
    }


def _of_members(place: str, support: TypeSupport) -> Iterator[tuple[str, object]]:
    """What is told of the fields, those of what they hold too."""
    members = IntrospectedType.from_address(support.data)
    yield f'{place}: identifier', support.identifier
    yield f'{place}: namespace', members.namespace
    yield f'{place}: name', members.name
    yield f'{place}: has a key', members.has_key
    yield f'{place}: number of fields', members.number
    for index in range(members.number):
        member = members.members[index]
        inner = f'{place}.{member.name.decode()}'
        yield inner, tuple(getattr(member, one) for one in _READ)
        if member.held:
            yield from _of_members(inner, member.held.contents)
