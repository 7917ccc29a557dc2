"""The source text of a Protobuf file, from its descriptor.

protoc and Schema Registries read it back as the same descriptor. The documentation in the options
of Confluent stands in the text twice, as comments, too: these reach the code that protoc makes.
"""

from collections.abc import Iterator
from typing import Any, Final

from confluent_kafka.schema_registry.confluent import meta_pb2
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
)

WORDS: Final = {
    number: name.removeprefix('TYPE_').lower()
    for name, number in vars(FieldDescriptor).items()
    if name.startswith('TYPE_')
}
"""The types of fields, as a source text has them."""


def source(file: FileDescriptorProto) -> str:
    """The source text of a file, as far as the bridge's schemas and `confluent/meta.proto` go."""
    return '\n'.join(_file(file)) + '\n'


def _file(file: FileDescriptorProto) -> Iterator[str]:
    yield f'syntax = "{file.syntax}";'
    yield ''
    yield f'package {file.package};'
    if file.dependency:
        yield ''
        yield from (f'import "{name}";' for name in file.dependency)
    if file.options.go_package:
        yield ''
        yield f'option go_package = {_text(file.options.go_package)};'
    for message in file.message_type:
        yield ''
        yield from _message(message)
    for extension in file.extension:
        yield ''
        yield f'extend {extension.extendee} {{'
        yield from _field(extension, {})
        yield '}'


def _message(message: DescriptorProto) -> Iterator[str]:
    meta = _meta(message, 'message_meta')
    yield from _comment(meta, '')
    yield f'message {message.name} {{'
    if message.options.deprecated_legacy_json_field_conflicts:
        yield f'{_IN}option deprecated_legacy_json_field_conflicts = true;'
    if meta is not None:
        yield f'{_IN}option (confluent.message_meta) = {_shown(meta)};'
    maps = {entry.name: entry for entry in message.nested_type if entry.options.map_entry}
    for number, field in enumerate(message.field):
        if number or meta is not None:
            yield ''
        yield from _field(field, maps)
    yield '}'


def _field(field: FieldDescriptorProto, maps: dict[str, DescriptorProto]) -> Iterator[str]:
    meta = _meta(field, 'field_meta')
    yield from _comment(meta, _IN)
    options = [f'json_name = {_text(field.json_name)}'] if field.json_name else []
    if meta is not None:
        options.append(f'(confluent.field_meta) = {_shown(meta)}')
    behind = f' [{", ".join(options)}]' if options else ''
    yield f'{_IN}{_type(field, maps)} {field.name} = {field.number}{behind};'


def _type(field: FieldDescriptorProto, maps: dict[str, DescriptorProto]) -> str:
    entry = maps.get(field.type_name.rpartition('.')[2])
    if entry is not None:
        key, value = (WORDS[member.type] for member in entry.field)
        return f'map<{key}, {value}>'
    repeated = 'repeated ' if field.label == FieldDescriptor.LABEL_REPEATED else ''
    return repeated + (field.type_name or WORDS[field.type])


def _meta(described: DescriptorProto | FieldDescriptorProto, name: str) -> Any:
    extension = getattr(meta_pb2, name)
    options: Any = described.options
    return options.Extensions[extension] if options.HasExtension(extension) else None


def _comment(meta: Any, indent: str) -> Iterator[str]:
    if meta is not None and meta.doc:
        yield from (f'{indent}// {line}'.rstrip() for line in meta.doc.split('\n'))


def _shown(meta: Any) -> str:
    parts = [f'doc: {_text(meta.doc)}'] if meta.doc else []
    params = [
        f'{{ key: {_text(key)}, value: {_text(value)} }}' for key, value in meta.params.items()
    ]
    parts += [f'params: [{", ".join(params)}]'] if params else []
    return f'{{ {", ".join(parts)} }}'


def _text(text: str) -> str:
    return '"' + text.translate(_ESCAPES) + '"'


_IN: Final = '  '
_ESCAPES: Final = {ord('"'): '\\"', ord('\\'): '\\\\', ord('\n'): '\\n'}
