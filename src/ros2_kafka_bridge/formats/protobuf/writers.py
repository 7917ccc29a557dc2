"""Who wrote a record: the schemas that the ids in records stand for, as Protobuf resolves them.

confluent's ProtobufDeserializer looks a schema up and then does not compare it with the reader's:
a record of another type is read as garbage, a field of another type is zero. It is not used
here: the schemas are compared once for each id, so that no value changes without a word.
"""

import base64
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from confluent_kafka.schema_registry import (
    prefix_schema_id_deserializer,
    protobuf,  # noqa: F401 -- loads what schemas import without a reference
)
from confluent_kafka.schema_registry.serde import SchemaId
from confluent_kafka.serialization import SerializationError
from google.protobuf import descriptor_pool
from google.protobuf.descriptor import Descriptor, FieldDescriptor, FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from google.protobuf.message import DecodeError as MalformedError

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.looks import framed_json
from ros2_kafka_bridge.formats.protobuf.source import WORDS
from ros2_kafka_bridge.formats.references import referenced
from ros2_kafka_bridge.formats.registry import (
    Registry,
    UnusableSchemaError,
    framed_id,
    kind_of,
    text_of,
)


class Writer(NamedTuple):
    """What is known of records with the same beginning.

    Args:
        start: Where the message begins.
        strict: Whether the writer knew no field that the reader does not know.
    """

    start: int
    strict: bool


class Writers:
    """The writers of the records of a route; each schema is asked for once.

    Making it asks nobody.

    Args:
        registry: Closed with this.
        reader: What the route reads.
        by_source: The files of that by their source text. Not every registry makes descriptors
            of sources when asked to, and no other text can be read here.
    """

    def __init__(
        self,
        registry: Registry,
        reader: Descriptor,
        by_source: Mapping[str, FileDescriptorProto],
    ) -> None:
        self._registry = registry
        self._registry.close_with(self)
        self._reader = reader
        self._by_source = by_source
        self._by_prefix: dict[bytes, Writer] = {}
        self._schemas: dict[int, FileDescriptor | str] = {}
        self._by_index: dict[tuple[int, tuple[int, ...]], bool | str] = {}

    def of(self, value: bytes) -> Writer:
        """Tell who wrote a value.

        Raises:
            DecodeError: It does not say so, or what was written cannot be read as this type.
            RouteError: The registry does not answer.
        """
        writer = self._by_prefix.get(value[:_SHORT_PREFIX])
        return writer or self._look_up(value)

    def _look_up(self, value: bytes) -> Writer:
        schema_id = framed_id(value)
        start, index = _message_index(value)
        compared = self._by_index.get((schema_id, index))
        if compared is None:
            # Kept only where the schema has such a message: any value can name any number.
            message = _found(self._schema(schema_id), index)
            if isinstance(message, str):
                raise DecodeError(f'schema {schema_id}: {message}')
            compared = self._by_index[schema_id, index] = self._compared(message)
        if isinstance(compared, str):
            raise DecodeError(f'schema {schema_id}: {compared}')
        writer = Writer(start, compared)
        if start == _SHORT_PREFIX:
            self._by_prefix[value[:_SHORT_PREFIX]] = writer
        return writer

    def _compared(self, writer: Descriptor) -> bool | str:
        """Whether the writer is strict, or why its records cannot be read."""
        if writer.full_name != self._reader.full_name:
            return f'is of {writer.full_name}, and this route reads {self._reader.full_name}'
        difference = next(_differences(writer, self._reader, '$', set()), None)
        if difference is None and _is_disjoint(writer, self._reader):
            return f'no field of {writer.full_name} there is one of it here: all would be zero'
        return difference or not _knows_more(writer, self._reader, set())

    def _schema(self, schema_id: int) -> FileDescriptor | str:
        """The file of a schema, or why it cannot be used; asked for once."""
        if schema_id not in self._schemas:
            try:
                self._schemas[schema_id] = self._read(schema_id)
            except UnusableSchemaError as error:
                self._schemas[schema_id] = str(error)
            except RecursionError:
                self._schemas[schema_id] = 'is nested too deeply'
        return self._schemas[schema_id]

    def _read(self, schema_id: int) -> FileDescriptor:
        client = self._registry.client
        with self._registry.reading(schema_id):
            schema = client.get_schema(schema_id, fmt='serialized')
            text, kind = text_of(schema), kind_of(schema)
            others = referenced(client, schema, fmt='serialized')
        if kind != 'PROTOBUF':
            raise UnusableSchemaError(f'is {kind}, not PROTOBUF')
        if schema.rule_set is not None:
            raise UnusableSchemaError('has rules, and the bridge does not apply a data contract')
        pool = descriptor_pool.DescriptorPool()
        for name, other in others:
            if not _has(pool, name):
                _added(self._file(name, other), pool)
        return _added(self._file(f'{schema_id}.proto', text), pool)

    def _file(self, name: str, text: str) -> FileDescriptorProto:
        file = FileDescriptorProto()
        try:
            known = self._by_source.get(text.strip())
            content = known.SerializeToString() if known else base64.b64decode(text, validate=True)
            file.ParseFromString(content)
        except (ValueError, MalformedError):
            raise UnusableSchemaError(
                f'{name} is no descriptor, and not what `ros2-kafka-bridge schema` prints: the '
                'registry does not serve ?format=serialized; register the descriptor, as the '
                'serializers of Python do'
            ) from None
        file.name = name
        return file


# A zero byte, 4 bytes of the id, and a zero byte for the first message of the schema.
_SHORT_PREFIX: Final = 6
_LONGEST_PREFIX: Final = 64
_LONGEST_SHOWN: Final = 60


def _message_index(value: bytes) -> tuple[int, tuple[int, ...]]:
    """Where the message begins, and which one of its schema it is."""
    # Cut short: confluent reads numbers of any length, in quadratic time.
    frame = SchemaId('PROTOBUF')
    try:
        rest = prefix_schema_id_deserializer(value[:_LONGEST_PREFIX], None, frame)
    except (EOFError, SerializationError):
        said = framed_json(value) or 'which message of its schema it is cannot be read'
        raise DecodeError(said) from None
    return rest.tell(), tuple(frame.message_indexes or [0])


def _added(file: FileDescriptorProto, pool: Any) -> FileDescriptor:
    """Adds a file to a pool, with what every reader of Protobuf has."""
    try:
        for imported in file.dependency:
            _add_shipped(imported, pool)
        pool.Add(file)
        found: FileDescriptor = pool.FindFileByName(file.name)
    except (TypeError, KeyError) as error:
        raise UnusableSchemaError(f'{file.name} cannot be used: {error}') from None
    return found


def _has(pool: Any, name: str) -> bool:
    try:
        pool.FindFileByName(name)
    except KeyError:
        return False
    return True


def _add_shipped(name: str, pool: Any) -> None:
    # Some registries have these as references, too.
    if not name.startswith(('google/', 'confluent/')) or _has(pool, name):
        return
    shipped = descriptor_pool.Default().FindFileByName(name)
    for inner in shipped.dependencies:
        _add_shipped(inner.name, pool)
    pool.AddSerializedFile(shipped.serialized_pb)


def _found(file: FileDescriptor | str, index: tuple[int, ...]) -> Descriptor | str:
    """The message of a schema, or why there is none."""
    if isinstance(file, str):
        return file
    messages = list(file.message_types_by_name.values())
    for number in index:
        if not 0 <= number < len(messages):
            return f'has no message {list(index)}'
        message = messages[number]
        messages = list(message.nested_types)
    return message


def _differences(
    writer: Descriptor, reader: Descriptor, path: str, seen: set[tuple[str, str]]
) -> Iterator[str]:
    """Fields whose values would change, or vanish, without a word."""
    if (writer.full_name, reader.full_name) in seen:
        return
    seen.add((writer.full_name, reader.full_name))
    for number, field in reader.fields_by_number.items():
        written = writer.fields_by_number.get(number)
        where = f'{path}.{field.name}'
        namesake = writer.fields_by_name.get(field.name)
        if namesake is not None and namesake.number != number:
            # Put in between, or in another order: its value would become that of another field.
            yield f'{where}: was written with the number {namesake.number}, and has {number} here'
        elif written is None:
            continue
        elif not _fits(written, field):
            there, here = _shown(written), _shown(field)
            yield f'{where}: was written as {there} {written.name}, and is {here} here'
        elif written.has_default_value and written.default_value:
            # It is not written where it is meant.
            default = f'{written.default_value!r:.{_LONGEST_SHOWN}}'
            yield f'{where}: was written with a default of its own ({default}), and is zero here'
        elif field.message_type and written.message_type:
            yield from _differences(written.message_type, field.message_type, where, seen)


def _is_disjoint(writer: Descriptor, reader: Descriptor) -> bool:
    """Whether both have fields, and none in common."""
    theirs, ours = set(writer.fields_by_number), set(reader.fields_by_number)
    return bool(theirs and ours) and theirs.isdisjoint(ours)


def _fits(written: FieldDescriptor, read: FieldDescriptor) -> bool:
    # A list may be longer than one, and one zero is not written.
    if written.is_repeated != read.is_repeated and not (read.is_repeated and written.has_presence):
        return False
    return written.type == read.type or read.type in _WIDER.get(written.type, ())


_T: Final = FieldDescriptor
_WIDER: Final = {
    _T.TYPE_BOOL: {_T.TYPE_INT32, _T.TYPE_UINT32, _T.TYPE_INT64, _T.TYPE_UINT64},
    _T.TYPE_INT32: {_T.TYPE_INT64},
    _T.TYPE_UINT32: {_T.TYPE_UINT64, _T.TYPE_INT64},
    _T.TYPE_ENUM: {_T.TYPE_INT32, _T.TYPE_INT64},
    _T.TYPE_STRING: {_T.TYPE_BYTES},
    _T.TYPE_BYTES: {_T.TYPE_STRING},
}


def _shown(field: FieldDescriptor) -> str:
    word = field.message_type.full_name if field.message_type else WORDS[field.type]
    return f'repeated {word}' if field.is_repeated else word


def _knows_more(writer: Descriptor, reader: Descriptor, seen: set[tuple[str, str]]) -> bool:
    if (writer.full_name, reader.full_name) in seen:
        return False
    seen.add((writer.full_name, reader.full_name))
    for number, written in writer.fields_by_number.items():
        field = reader.fields_by_number.get(number)
        if field is None:
            return True
        inner = (written.message_type, field.message_type)
        if inner[0] and inner[1] and _knows_more(inner[0], inner[1], seen):
            return True
    return False
