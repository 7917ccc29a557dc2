"""Schemas of strangers: whether fastavro may read values with them.

It reads for ever, or ends the process, with some kinds of schema; they are found here, before the
first value is read.
"""

from dataclasses import dataclass, field
from typing import Any, Final

from ros2_kafka_bridge.formats.avro.resolution import Types

_RECORDS: Final = frozenset({'error', 'record'})
_MOST_WITHOUT_BYTES: Final = 100
_DEEPEST: Final = 200

_NUMBER: Final = frozenset({'logicalType', 'precision', 'scale'})
_READ: Final = _NUMBER | {
    *('type', 'name', 'namespace', 'fields', 'items', 'values', 'symbols', 'size'),
}


class UnsafeError(Exception):
    """Why no value of a schema may be read, as said of it: `has ...`."""


def only_read(schema: Any) -> Any:
    """Leave of a schema, as JSON has it, what tells how a value is read.

    fastavro takes a schema with marks of its own for parsed, whatever is in it; it refuses one for
    a default that no reader needs; and it makes dates and numbers of logical types, which no
    message has, and needs minutes for a decimal of a million bytes. Without these every value is
    read as what it is underneath, as Avro allows; a fixed one is the uint64 of ours, or does not
    fit.
    """
    if isinstance(schema, list):
        return [only_read(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    read = _READ if schema.get('type') == 'fixed' else _READ - _NUMBER
    return {key: only_read(value) for key, value in schema.items() if key in read}


def check_safe(schema: Any, types: Types) -> None:
    """Look whether values of a schema may be read.

    Args:
        schema: As fastavro has parsed it.
        types: All that have a name.

    Raises:
        UnsafeError: They may not.
    """
    _Look(types).depth(schema, ())


@dataclass(frozen=True, slots=True)
class _Look:
    types: Types
    _depths: dict[str, int] = field(default_factory=dict)
    _without: dict[str, int] = field(default_factory=dict)

    def depth(self, schema: Any, around: tuple[str, ...]) -> int:
        """How deep the values of a schema nest.

        Args:
            schema: It.
            around: The types that it stands in.
        """
        if isinstance(schema, list):
            return self._deeper(schema, around)
        if isinstance(schema, str):
            return self._depth_of_name(schema, around)
        match schema['type']:
            case 'record' | 'error':
                return self._depth_of_record(schema, around)
            case 'array' if self._without_bytes(schema['items']):
                raise UnsafeError('has an array of items without bytes: it could be of any length')
            case 'fixed' if type(schema['size']) is not int or schema['size'] < 1:
                raise UnsafeError(f'has a fixed type of {schema["size"]} bytes')
        return self._deeper([schema[key] for key in ('items', 'values') if key in schema], around)

    def _depth_of_name(self, name: str, around: tuple[str, ...]) -> int:
        if name in around:
            raise UnsafeError(f'has the type {name} within itself, as no message type does')
        if name in self.types and name not in self._depths:
            self._depths[name] = self.depth(self.types[name], around)
        return self._depths.get(name, 0)

    def _depth_of_record(self, record: Any, around: tuple[str, ...]) -> int:
        name, inner = record['name'], [one['type'] for one in record['fields']]
        if sum(map(self._without_bytes, inner)) > _MOST_WITHOUT_BYTES:
            raise UnsafeError(
                f'has {_MOST_WITHOUT_BYTES} fields without bytes in {name}, and more'
            )
        self._depths[name] = self._deeper(inner, (*around, name))
        return self._depths[name]

    def _deeper(self, inner: list[Any], around: tuple[str, ...]) -> int:
        depth = 1 + max((self.depth(one, around) for one in inner), default=0)
        if depth > _DEEPEST:
            raise UnsafeError(f'is nested too deeply: more than {_DEEPEST} levels')
        return depth

    def _without_bytes(self, schema: Any) -> int:
        """How much is read of a value that takes no bytes; 0 where every value takes some."""
        if isinstance(schema, list):
            return 0
        kind = schema if isinstance(schema, str) else schema['type']
        if kind in self.types:
            return self._without_bytes(self.types[kind])
        if kind not in _RECORDS:
            return int(kind == 'null')
        name = schema['name']
        if name not in self._without:
            # A type within itself is refused where the look comes to it.
            self._without[name] = 0
            inner = [self._without_bytes(one['type']) for one in schema['fields']]
            self._without[name] = 1 + sum(inner) if all(inner) else 0
        return self._without[name]
