"""Schemas as a stranger may register them: those of a message type, changed at random.

What is changed, and how, comes from bytes: a fuzzer that changes the bytes leads the changes.
"""

import json
from base64 import b64encode
from collections.abc import Iterator, Sequence
from typing import Any, Final, TypeVar

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
)

One = TypeVar('One')
MOST_CHANGES: Final = 8


class Choices:
    """Choices that are made by bytes; the first one, once there are no more.

    Args:
        data: Each byte makes one choice.
    """

    def __init__(self, data: bytes) -> None:
        self._data = iter(data)

    def number(self, below: int) -> int:
        """Choose a number from 0 on."""
        return next(self._data, 0) % below if below else 0

    def of(self, some: Sequence[One]) -> One:
        """Choose one of some."""
        return some[self.number(len(some))]


# Avro

_PRIMITIVES: Final = (
    'null', 'boolean', 'int', 'long', 'float', 'double', 'bytes', 'string',
)  # fmt: skip
_LOGICAL: Final = (
    'decimal', 'date', 'uuid', 'time-millis', 'time-micros', 'timestamp-millis',
    'timestamp-micros', 'local-timestamp-millis', 'duration', 'none',
)  # fmt: skip
_NUMBERS: Final = (0, 1, 2, 3, 9, 20, 21, 40, 300, -1, 2**31, 10**9)
_NAMES: Final = ('a', 'data', 'header', 'Header', 'x', 'value', '', 'a.b', 'std_msgs.msg.Header')


def avro_text(schema: Any, data: bytes) -> str:
    """Change an Avro schema, and give the text of it."""
    choices = Choices(data)
    changed = json.loads(json.dumps(schema))
    for _ in range(choices.number(MOST_CHANGES)):
        _change_avro(changed, choices)
    wrapped = choices.number(16)
    if wrapped == 1:
        changed = ['null', changed]
    elif wrapped == 2:
        changed = {'type': 'array', 'items': changed}
    return json.dumps(changed)


def _change_avro(schema: Any, choices: Choices) -> None:
    record = choices.of(list(_records(schema)))
    fields = record['fields']
    match choices.number(10):
        case 0 if fields:
            del fields[choices.number(len(fields))]
        case 1 if fields:
            choices.of(fields)['type'] = _any_avro(schema, choices)
        case 2 if fields:
            one = choices.of(fields)
            one['type'] = ['null', one['type']]
        case 3:
            name = choices.of(_NAMES)
            fields.insert(choices.number(3), {'name': name, 'type': _any_avro(schema, choices)})
        case 4:
            fields.reverse()
        case 5:
            record['name'] = choices.of(_NAMES)
        case 6:
            record['namespace'] = choices.of(_NAMES)
        case 7:
            # fastavro's own.
            named = {choices.of(_NAMES): _any_avro(schema, choices)}
            schema |= {'__fastavro_parsed': True, '__named_schemas': named}
        case 8:
            one = choices.of(list(_dicts(schema)))
            one['logicalType'] = choices.of(_LOGICAL)
            one['precision'] = choices.of(_NUMBERS)
            one['scale'] = choices.of(_NUMBERS)
        case _:
            one = choices.of(list(_dicts(schema)))
            one[choices.of(list(one))] = choices.of([*_NAMES, *_NUMBERS, None, [], {}])


def _any_avro(schema: Any, choices: Choices) -> Any:
    inner = choices.of(_PRIMITIVES)
    names = [str(record.get('name')) for record in _records(schema)]
    match choices.number(8):
        case 0 | 1 | 2:
            return inner
        case 3:
            return {'type': 'array', 'items': inner}
        case 4:
            return {'type': 'map', 'values': {'type': 'array', 'items': choices.of(names)}}
        case 5:
            size = choices.of(_NUMBERS)
            fixed = {'type': 'fixed', 'name': choices.of(_NAMES), 'size': size}
            return choices.of([fixed, {'type': 'array', 'items': fixed}])
        case 6:
            return choices.of([*names, 'nothing'])
        case _:
            return [inner, {'type': 'enum', 'name': 'colour', 'symbols': ['RED']}]


def _dicts(schema: Any) -> Iterator[dict[str, Any]]:
    if isinstance(schema, list):
        for one in schema:
            yield from _dicts(one)
    elif isinstance(schema, dict):
        if schema:
            yield schema
        for one in schema.values():
            yield from _dicts(one)


def _records(schema: Any) -> Iterator[dict[str, Any]]:
    found = [one for one in _dicts(schema) if isinstance(one.get('fields'), list)]
    yield from found or [{'name': 'none', 'fields': []}]


# Protobuf

_LABELS: Final = FieldDescriptorProto.Label.values()
_FILES: Final = ('google/protobuf/timestamp.proto', 'google/none.proto', 'missing.proto')


def protobuf_texts(files: Sequence[FileDescriptorProto], data: bytes) -> dict[str, str]:
    """Change the descriptors of some files, and give them by name as a registry does."""
    choices = Choices(data)
    changed = [FileDescriptorProto() for _ in files]
    for file, one in zip(files, changed, strict=True):
        one.CopyFrom(file)
    for _ in range(choices.number(MOST_CHANGES)):
        _change_protobuf(changed[-1 - choices.number(len(files))], choices)
    return {
        file.name: b64encode(one.SerializeToString()).decode()
        for file, one in zip(files, changed, strict=True)
    }


def _change_protobuf(file: FileDescriptorProto, choices: Choices) -> None:
    messages = list(file.message_type) or [file.message_type.add(name='Added')]
    message = choices.of(messages)
    match choices.number(8):
        case 0:
            message.name = choices.of(_NAMES)
        case 1:
            file.package = choices.of(_NAMES)
        case 2:
            file.syntax = choices.of(('proto2', 'proto3', 'editions', 'proto9', ''))
        case 3:
            message.nested_type.add(name='Inner').field.add(name='a', number=1, type=5, label=1)
        case 4:
            file.message_type.insert(0, DescriptorProto(name='Before'))
        case 5:
            file.dependency.append(choices.of(_FILES))
        case _:
            _change_field(file, message, choices)


def _change_field(file: FileDescriptorProto, message: DescriptorProto, choices: Choices) -> None:
    fields = list(message.field) or [message.field.add(name='added', number=1, type=5, label=1)]
    field = choices.of(fields)
    match choices.number(6):
        case 0:
            message.field.remove(field)
        case 1:
            field.number = choices.of((0, 1, 2, 3, 7, 19000, 2**29 - 1))
        case 2:
            field.label = choices.of(_LABELS)
        case 3:
            field.name = choices.of(_NAMES)
        case 4:
            message.oneof_decl.add(name='either')
            field.oneof_index = choices.number(2)
        case _:
            _set_type(field, [one.name for one in file.message_type], choices)


def _set_type(field: FieldDescriptorProto, names: list[str], choices: Choices) -> None:
    field.type = choices.of(FieldDescriptorProto.Type.values())
    field.ClearField('type_name')
    if field.type in {FieldDescriptorProto.TYPE_MESSAGE, FieldDescriptorProto.TYPE_GROUP}:
        field.type_name = choices.of(['.google.protobuf.Timestamp', 'nothing', *names])
