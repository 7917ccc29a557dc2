"""What a registry knows of schemas: which are the same, which are none, which fit together."""

import base64
import functools
import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import avro.compatibility
import avro.errors
import avro.name
import avro.schema
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
from google.protobuf.message import DecodeError

References = tuple[tuple[str, str, int], ...]
"""Name, subject and version of each schema that another one refers to."""

Schema = tuple[str, list[str]]
"""The text of one, and the texts that it refers to, each behind those that it needs."""


class Entry(NamedTuple):
    """One version of a subject."""

    subject: str
    version: int
    id: int
    kind: str
    text: str
    references: References
    rules: dict[str, Any] | None = None

    @property
    def shown(self) -> dict[str, Any]:
        """The schema as an answer has it."""
        shown: dict[str, Any] = {'schema': self.text}
        if self.kind != 'AVRO':
            shown['schemaType'] = self.kind
        if self.references:
            shown['references'] = [
                {'name': name, 'subject': subject, 'version': version}
                for name, subject, version in self.references
            ]
        return shown | ({'ruleSet': self.rules} if self.rules else {})


class RefusedError(Exception):
    """An answer that is no success."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message

    @property
    def status(self) -> int:
        """The status of HTTP within a code of the registry: 404 in 40403."""
        return self.code if self.code < 1000 else self.code // 100


@functools.cache  # a registry asks for those of all that it has, each time
def key(kind: str, text: str, references: References) -> tuple[Any, ...]:
    """What makes two schemas the same: spaces do not, nor does the order of properties."""
    with suppress(ValueError, RecursionError):
        text = json.dumps(json.loads(text), sort_keys=True)
    return kind, text, references


def check(kind: str, text: str, named: list[str]) -> None:
    """Refuse what is no schema of its kind; `named` are the texts that it refers to."""
    try:
        if kind == 'AVRO':
            _avro(text, named)
        elif kind == 'PROTOBUF':
            _protobuf(text)
        else:
            json.loads(text)
    except (avro.errors.AvroException, ValueError, DecodeError) as error:
        raise RefusedError(42201, f'Invalid schema {text[:200]}, details: {error}') from None


def _avro(text: str, named: list[str]) -> Any:
    names = avro.name.Names(validate_names=True)
    for other in named:
        avro.schema.make_avsc_object(json.loads(other), names)
    return avro.schema.make_avsc_object(json.loads(text), names)


def misfits(kind: str, reader: Schema, writer: Schema) -> list[str]:
    """Why what one has written cannot be read with the other, in the registry's words."""
    if kind == 'AVRO':
        return _avro_details(reader, writer)
    return _protobuf_details(reader, writer) if kind == 'PROTOBUF' else []


def _avro_details(reader: Schema, writer: Schema) -> list[str]:
    checker: Any = avro.compatibility.ReaderWriterCompatibilityChecker  # it has no types
    result = checker().get_compatibility(_avro(*reader), _avro(*writer))
    if result.compatibility is avro.compatibility.SchemaCompatibilityType.compatible:
        return []
    kinds = [kind.name.upper() for kind in result.incompatibilities]
    return [
        f"{{errorType:'{kinds[0]}', description:'{message}', additionalInfo:'{place}'}}"
        for message, place in zip(sorted(result.messages), sorted(result.locations), strict=False)
    ]


def _protobuf(text: str) -> FileDescriptorProto:
    return FileDescriptorProto.FromString(base64.b64decode(text, validate=True))


def _protobuf_details(reader: Schema, writer: Schema) -> list[str]:
    news = dict(_messages(_protobuf(reader[0]).message_type, ''))
    olds = dict(_messages(_protobuf(writer[0]).message_type, ''))
    details = [
        f"{{errorType:'MESSAGE_REMOVED', description:'message removed', additionalInfo:'{name}'}}"
        for name in olds
        if name not in news
    ]
    for name, old in olds.items():
        numbers = {field.number: field for field in news[name].field} if name in news else {}
        for field in old.field:
            now = numbers.get(field.number)
            if now and (now.type, now.type_name, now.label) != (
                field.type,
                field.type_name,
                field.label,
            ):
                details.append(
                    f"{{errorType:'FIELD_SCALAR_KIND_CHANGED', description:'the kind changed', "
                    f"additionalInfo:'{name}.{field.name}'}}"
                )
    return details


def _messages(found: Any, prefix: str) -> Iterator[tuple[str, DescriptorProto]]:
    for message in found:
        yield f'{prefix}{message.name}', message
        yield from _messages(message.nested_type, f'{prefix}{message.name}.')
