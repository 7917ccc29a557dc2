"""Formats: how a record's value encodes a message. A file or folder each, one table.

A format is asked once, when its route starts, for the functions that its loop will call:
`decode` makes the CDR bytes of a message from a record's value, `encode` the reverse. It knows the
type and the settings alone; from outside only a Schema Registry is asked.
"""

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from ros2_kafka_bridge.errors import (
    BridgeError,
    DecodeError,
    EncodeError,
    RecordTooLargeError,
    blamed,
    error_of_bug,
)
from ros2_kafka_bridge.formats import cdr, text
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Layout

Decode = Callable[[bytes | None], bytes]
"""Value of a record (None: a tombstone) -> CDR bytes. Raises DecodeError."""

Encode = Callable[[bytes], bytes | None]
"""CDR bytes -> value of a record. Raises EncodeError."""


Value = TypeVar('Value', bound=bytes | None)
Converted = TypeVar('Converted')


class Format(NamedTuple):
    """One way to write a message into a record.

    Args:
        make_decode: Raises ConfigError where the format cannot carry the type. The function made
            may raise RouteError, too, where a Schema Registry does not answer.
        make_encode: Raises ConfigError where the format cannot carry the type, and RouteError
            where a Schema Registry does not answer or refuses the schema: the function made asks
            no network.
        message_types: The types that it can carry; None means every type.
    """

    make_decode: Callable[[Layout, Scope], Decode]
    make_encode: Callable[[Layout, Scope], Encode]
    message_types: frozenset[str] | None


def _format(
    name: str, module: ModuleType | None = None, message_types: frozenset[str] | None = None
) -> Format:
    """A format; without a module, it is loaded when the first route of it starts.

    What a package describes oddly, and what the library of a format does not take, is theirs.
    """

    def making(direction: str) -> Callable[[Layout, Scope], Any]:
        def make(layout: Layout, scope: Scope) -> Any:
            with blamed(f'{name} cannot carry {layout.type_name}'):
                loaded = module or import_module(f'{__name__}.{name}')
                return getattr(loaded, direction)(layout, scope)

        return make

    return Format(making('make_decode'), making('make_encode'), message_types)


FORMATS: dict[str, Format] = {
    'text': _format('text', text, frozenset({'std_msgs/msg/String'})),
    'cdr': _format('cdr', cdr),
    'json': _format('json'),
    'avro': _format('avro'),
    'protobuf': _format('protobuf'),
}


def guarded(
    convert: Callable[[Value], Converted],
    max_message_bytes: int,
    kind: type[DecodeError] | type[EncodeError],
) -> Callable[[Value], Converted]:
    """Make a decode or encode function whose every failure is one of the bridge's own errors.

    Args:
        convert: The function of the format.
        max_message_bytes: As the route has it. What is larger is a RecordTooLargeError.
        kind: What a bug of `convert` becomes.
    """

    def convert_guarded(value: Value) -> Converted:
        if value is not None and len(value) > max_message_bytes:
            raise RecordTooLargeError(
                len(value), max_message_bytes, 'max_message_bytes of the route'
            )
        # Here, because one more call for each record would cost more than this does.
        try:
            return convert(value)
        except BridgeError:
            raise
        except Exception as bug:
            raise error_of_bug(kind, bug) from bug

    return convert_guarded
