"""Records whose schema is a stranger's: what a Schema Registry may have, and what is read by it.

The first byte of an input is the length of what changes the schema of the message type
(`schema_mutations`); the rest is the value behind the id of that schema.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Final, cast

if TYPE_CHECKING:
    from ros2_kafka_bridge.formats.registry import Registry
    from ros2_kafka_bridge.message_types.layout import Layout

VERSIONS: Final = {'avro_versions': 'avro', 'protobuf_versions': 'protobuf'}
"""The formats of the fuzzer, and of the bridge."""

FRAME: Final = b'\0\0\0\0\1'
MAX_BYTES: Final = 1_000_000

ReadChanged = Callable[[bytes, bytes], bytes]
"""(what changes the schema, record) -> message."""


class _Schemas:
    """A registry of some schemas, that asks nobody: the last one has the id 1."""

    def __init__(self, kind: str, files: Mapping[str, str]) -> None:
        # Each file of Protobuf may need all before it.
        references = [SimpleNamespace(name=name, subject=name, version=1) for name in files]
        some = [
            SimpleNamespace(
                schema_str=text,
                schema_type=kind,
                references=references[:number],
                rule_set=None,
            )
            for number, text in enumerate(files.values())
        ]
        versions = dict(zip(files, some, strict=True))
        self.client = SimpleNamespace(
            get_schema=lambda _, **_more: some[-1],
            get_version=lambda name, _, **_more: SimpleNamespace(schema=versions[name]),
        )

    @contextmanager
    def reading(self, _schema_id: int) -> Iterator[None]:
        yield

    def close_with(self, _owner: object) -> None:
        pass


def registry_of(kind: str, files: Mapping[str, str]) -> 'Registry':
    """Make a registry of some schemas, by their names in order; the last one has the id 1."""
    return cast('Registry', _Schemas(kind, files))


def make_check(format_name: str, layout: 'Layout') -> Callable[[bytes], None]:
    """Make the function from an input that lets only the errors of the bridge pass."""
    from ros2_kafka_bridge.errors import DecodeError, RecordTooLargeError  # noqa: PLC0415

    make = read_changed_avro if format_name == 'avro_versions' else read_changed_protobuf
    read_changed = make(layout)

    def check(data: bytes) -> None:
        behind = 1 + data[0]
        try:
            read_changed(data[1:behind], FRAME + data[behind:])
        except (DecodeError, RecordTooLargeError):
            return

    return check


def versions_of(format_name: str, value: bytes) -> Iterator[bytes]:
    """Inputs to begin with: a value by the schema itself, and by some that are not far from it."""
    # Which message of its schema it is.
    behind_id = b'\0' if format_name == 'protobuf_versions' else b''
    # How many changes there are, and some bytes for each.
    changes = (b'', b'\1\0\0\0', b'\1\0\2\0', b'\2\0\1\0\3', b'\3' + bytes(range(16)))
    for change in changes:
        yield bytes([len(change)]) + change + behind_id + value


def read_changed_avro(layout: 'Layout') -> ReadChanged:
    """Make the function that reads records by a change of a type's Avro schema."""
    from benchmarks.schema_mutations import avro_text  # noqa: PLC0415
    from ros2_kafka_bridge.formats.avro import make_to_cdr, read_by_id  # noqa: PLC0415
    from ros2_kafka_bridge.formats.avro.schema import avro_schema  # noqa: PLC0415

    schema = avro_schema(layout)
    to_cdr = make_to_cdr(layout, MAX_BYTES)

    def read_changed(change: bytes, value: bytes) -> bytes:
        registry = registry_of('AVRO', {'changed': avro_text(schema, change)})
        return to_cdr(read_by_id(layout, registry)(value))

    return read_changed


def read_changed_protobuf(layout: 'Layout') -> ReadChanged:
    """Make the function that reads records by a change of one of a type's descriptors."""
    from benchmarks.schema_mutations import protobuf_texts  # noqa: PLC0415
    from ros2_kafka_bridge.formats.protobuf import make_read_by_id  # noqa: PLC0415
    from ros2_kafka_bridge.formats.protobuf.convert import STYLE  # noqa: PLC0415
    from ros2_kafka_bridge.formats.protobuf.schema import make_class, make_files  # noqa: PLC0415
    from ros2_kafka_bridge.formats.values.write import make_write  # noqa: PLC0415

    files = make_files(layout)
    read_by_id = make_read_by_id(layout, make_class(layout))
    write = make_write(layout, STYLE, MAX_BYTES)

    def read_changed(change: bytes, value: bytes) -> bytes:
        registry = registry_of('PROTOBUF', protobuf_texts(files, change))
        return write(read_by_id(registry)(value))

    return read_changed
