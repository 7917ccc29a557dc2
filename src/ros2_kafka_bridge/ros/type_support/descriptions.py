"""The C structures of a type description (REP 2016), filled and read."""

from collections.abc import Mapping

from ros2_kafka_bridge.message_types.description import (
    FieldDescription,
    FieldType,
    TypeDescription,
    held_names,
)
from ros2_kafka_bridge.ros.type_support.structures import (
    DescribedField,
    DescribedFields,
    DescribedType,
    Description,
    FieldKind,
    HeldTypes,
    Text,
)


def fill(name: str, types: Mapping[str, TypeDescription]) -> Description:
    """Describe a type and all that it holds, as the library of its package does.

    Args:
        name: As `std_msgs/msg/String`.
        types: At least that type and all that it holds.
    """
    held = [_type(types[one]) for one in held_names(name, types)]
    number = len(held)
    return Description(
        _type(types[name]), HeldTypes((DescribedType * number)(*held), number, number)
    )


def read(description: Description) -> tuple[TypeDescription, ...]:
    """The type that is described, and behind it what it holds, in the order there."""
    held = description.held
    every = (description.described, *(held.data[index] for index in range(held.size)))
    return tuple(map(_read_type, every))


def _type(one: TypeDescription) -> DescribedType:
    fields = [_field(field) for field in one.fields]
    number = len(fields)
    array = (DescribedField * number)(*fields)
    return DescribedType(_text(one.type_name), DescribedFields(array, number, number))


def _field(field: FieldDescription) -> DescribedField:
    kind = FieldKind(
        field.type.type_id,
        field.type.capacity,
        field.type.string_capacity,
        _text(field.type.nested_type_name),
    )
    return DescribedField(_text(field.name), kind, _text(field.default_value))


def _text(text: str) -> Text:
    data = text.encode()
    return Text(data, len(data), len(data) + 1)


def _read_type(one: DescribedType) -> TypeDescription:
    fields = one.fields
    read_fields = tuple(_read_field(fields.data[index]) for index in range(fields.size))
    return TypeDescription(_read_text(one.name), read_fields)


def _read_field(field: DescribedField) -> FieldDescription:
    kind = field.kind
    return FieldDescription(
        _read_text(field.name),
        FieldType(kind.type_id, kind.capacity, kind.string_capacity, _read_text(kind.held)),
        _read_text(field.default),
    )


def _read_text(text: Text) -> str:
    data: bytes | None = text.data
    return (data or b'').decode()
