"""Protobuf schemas of message types: descriptors, classes and source text.

Each message type becomes one file, `std_msgs/msg/Header.proto` with the package `std_msgs.msg`,
that imports those of the types in it. A field has the number of its place, counted from 1.

What Protobuf has no word for stands in the options that Confluent's `confluent/meta.proto`
declares: every Schema Registry and client of that protocol has this file, and keeps them.
`(confluent.message_meta)` has the documentation, the constants and the type hash,
`(confluent.field_meta)` the documentation and the type in ROS where it is narrower.
"""

import re
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.values.structs import is_byte
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
    dotted_name,
    ros_type,
)
from ros2_kafka_bridge.outside.extras import missing_extra

if TYPE_CHECKING:
    from google.protobuf.descriptor import FieldDescriptor
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
    from google.protobuf.message import Message

TYPE_HASH: Final = 'ros.type_hash'
ROS_TYPE: Final = 'ros.type'
_META: Final = 'confluent/meta.proto'


class _Protobuf(NamedTuple):
    """The parts of the library that are used here: it is loaded by routes that need it alone."""

    descriptor_pb2: Any
    descriptor_pool: Any
    message_factory: Any
    meta_pb2: Any
    types: 'type[FieldDescriptor]'


def _protobuf() -> _Protobuf:
    try:
        from confluent_kafka.schema_registry.confluent import meta_pb2  # noqa: PLC0415 -- heavy
        from google.protobuf import (  # noqa: PLC0415 -- heavy
            descriptor_pb2,
            descriptor_pool,
            message_factory,
        )
        from google.protobuf.descriptor import FieldDescriptor  # noqa: PLC0415 -- heavy
    except ImportError as error:
        problem = missing_extra('protobuf') or f'protobuf cannot be loaded: {error}'
        raise ConfigError([problem]) from None
    return _Protobuf(descriptor_pb2, descriptor_pool, message_factory, meta_pb2, FieldDescriptor)


def file_name(type_name: str) -> str:
    """The file of a type, which is also the name of its reference in a Schema Registry."""
    return f'{type_name}.proto'


def make_files(layout: Layout) -> 'list[FileDescriptorProto]':
    """Make the files of a message type and of all types in it.

    Returns:
        The files in order: each behind those that it imports, but for `confluent/meta.proto`.

    Raises:
        ConfigError: Protobuf cannot carry the type, or is not installed.
    """
    protobuf = _protobuf()
    made: dict[str, FileDescriptorProto] = {}
    _add_file(layout, protobuf, made)
    return list(made.values())


def make_class(layout: Layout) -> 'type[Message]':
    """Make the class of a message type, in a pool of its own: it never meets the user's classes.

    Raises:
        ConfigError: Protobuf cannot carry the type, or is not installed.
    """
    protobuf = _protobuf()
    pool = protobuf.descriptor_pool.DescriptorPool()
    for shipped in (protobuf.descriptor_pb2.DESCRIPTOR, protobuf.meta_pb2.DESCRIPTOR):
        pool.AddSerializedFile(shipped.serialized_pb)
    for file in make_files(layout):
        pool.Add(file)
    descriptor = pool.FindMessageTypeByName(dotted_name(layout))
    made: type[Message] = protobuf.message_factory.GetMessageClass(descriptor)
    return made


def protobuf_sources(layout: Layout) -> dict[str, str]:
    """The `.proto` source of a message type and of all that it imports, by the name of the file.

    protoc compiles it to the schema that the bridge registers.

    Raises:
        ConfigError: Protobuf cannot carry the type, or is not installed.
    """
    from ros2_kafka_bridge.formats.protobuf.source import source  # noqa: PLC0415 -- heavy

    files = make_files(layout)
    if any(_META in file.dependency for file in files):
        meta = _protobuf().descriptor_pb2.FileDescriptorProto()
        _protobuf().meta_pb2.DESCRIPTOR.CopyToProto(meta)
        files.insert(0, meta)
    return {file.name: source(file) for file in files}


def protobuf_schema(layout: Layout) -> str:
    """The `.proto` sources of a message type, one file behind the other, its own first.

    Raises:
        ConfigError: Protobuf cannot carry the type, or is not installed.
    """
    sources = reversed(protobuf_sources(layout).items())
    return '\n'.join(f'// ----- {name} -----\n\n{text}' for name, text in sources)


def _add_file(layout: Layout, protobuf: _Protobuf, made: 'dict[str, FileDescriptorProto]') -> None:
    if layout.type_name in made:
        return
    inner = {kind.type_name: kind for kind in map(_item, layout.fields) if _is_layout(kind)}
    for kind in inner.values():
        _add_file(kind, protobuf, made)
    package, _, name = dotted_name(layout).rpartition('.')
    _check_name(layout.type_name, name)
    file = protobuf.descriptor_pb2.FileDescriptorProto(
        name=file_name(layout.type_name), package=package, syntax='proto3'
    )
    message = file.message_type.add(name=name)
    for number, field in enumerate(layout.fields, 1):
        _add_field(message, number, field, layout, protobuf)
    if _clash(message):
        # protoc compares the names that JSON would have without the ones given here.
        message.options.deprecated_legacy_json_field_conflicts = True
    doc = '\n\n'.join(filter(None, [layout.doc, _constants(layout.constants)]))
    hashes = {TYPE_HASH: layout.type_hash} if layout.type_hash else {}
    _describe(message, protobuf.meta_pb2.message_meta, doc, hashes)
    described = [message, *message.field]
    imports = [_META] if any(one.HasField('options') for one in described) else []
    file.dependency.extend([*imports, *map(file_name, inner)])
    made[layout.type_name] = file


def _item(field: Field) -> Any:
    return field.kind.item if isinstance(field.kind, Array | Sequence) else field.kind


def _is_layout(kind: Kind) -> bool:
    return isinstance(kind, Layout)


_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')


def _check_name(type_name: str, name: str) -> None:
    if not _NAME.fullmatch(name):
        raise ConfigError([f'{type_name}: format protobuf cannot carry the name {name!r}'])


def _add_field(
    message: 'DescriptorProto', number: int, field: Field, layout: Layout, protobuf: _Protobuf
) -> None:
    _check_name(layout.type_name, field.name)
    made: Any = message.field.add(name=field.name, number=number)
    if field.name != _json_name(field.name):
        made.json_name = field.name
    made.label = protobuf.types.LABEL_REPEATED if is_repeated(field.kind) else _SINGLE
    item = _item(field)
    if isinstance(item, Array | Sequence):
        where = f'{layout.type_name}.{field.name}'
        raise ConfigError([f'{where}: format protobuf cannot carry a list of lists'])
    if isinstance(item, Layout):
        made.type = protobuf.types.TYPE_MESSAGE
        made.type_name = f'.{dotted_name(item)}'
    elif isinstance(field.kind, Array | Sequence) and is_byte(item):
        made.type = protobuf.types.TYPE_BYTES
    else:
        word = 'string' if isinstance(item, String) else _SCALARS[item.name]
        made.type = getattr(protobuf.types, f'TYPE_{word.upper()}')
    narrow = _is_narrower(field.kind)
    params = {ROS_TYPE: ros_type(field.kind)} if narrow else {}
    _describe(made, protobuf.meta_pb2.field_meta, field.doc, params)


_SINGLE: Final = 1

_SCALARS: Final = {
    'bool': 'bool',
    'byte': 'uint32',
    'float32': 'float',
    'float64': 'double',
    'int8': 'int32',
    'int16': 'int32',
    'int32': 'int32',
    'int64': 'int64',
    'uint8': 'uint32',
    'uint16': 'uint32',
    'uint32': 'uint32',
    'uint64': 'uint64',
}


def is_repeated(kind: Kind) -> bool:
    """Whether a field is `repeated`; bytes are not."""
    return isinstance(kind, Array | Sequence) and not is_byte(kind.item)


def _is_narrower(kind: Kind) -> bool:
    match kind:
        case Primitive():
            return kind.name in {'byte', 'int8', 'int16', 'uint8', 'uint16'}
        case String():
            return kind.wide or kind.bound is not None
        case Array():
            return True
        case Sequence():
            return kind.bound is not None or _is_narrower(kind.item)
        case Layout():
            return False


def _json_name(name: str) -> str:
    """The name that Protobuf's JSON has for a field where nobody gives one."""
    first, *others = name.split('_')
    return first + ''.join(word[:1].upper() + word[1:] for word in others)


def _clash(message: 'DescriptorProto') -> bool:
    names = [_json_name(field.name) for field in message.field]
    return len(set(names)) < len(names)


def _constants(constants: tuple[Constant, ...]) -> str:
    return '\n'.join(map(_constant, constants))


def _constant(constant: Constant) -> str:
    doc = ' '.join(constant.doc.split())
    value = repr(constant.value)
    shown = value.lower() if isinstance(constant.value, bool) else value
    words = f'{ros_type(constant.kind)} {constant.name} = {shown}'
    return f'{words}: {doc}' if doc else words


def _describe(target: Any, meta: Any, doc: str, params: dict[str, str]) -> None:
    # At most one parameter each: the order of a map is not kept, and a schema in another order
    # would be another version for the registry.
    assert len(params) <= 1
    if doc or params:
        option = target.options.Extensions[meta]
        option.doc = _CONTROL.sub(' ', doc)
        option.params.update(params)


_CONTROL: Final = re.compile(r'[\x00-\x09\x0b-\x1f\x7f]')
