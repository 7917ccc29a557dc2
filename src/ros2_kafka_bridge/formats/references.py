"""The schemas that a schema of a stranger refers to."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, NamedTuple

from ros2_kafka_bridge.formats.registry import UnusableSchemaError, text_of

if TYPE_CHECKING:
    from confluent_kafka.schema_registry import Schema, SchemaRegistryClient

_MOST: Final = 1000
_DEEPEST: Final = 100


class Referenced(NamedTuple):
    """A schema that another one refers to, by the name that it has there."""

    name: str
    text: str


def referenced(
    client: 'SchemaRegistryClient', schema: 'Schema', fmt: str | None = None
) -> list[Referenced]:
    """All schemas that a schema refers to, each once and behind those that it needs.

    Args:
        client: Asked for each.
        schema: What refers to them.
        fmt: In which format the registry is to write them.

    Raises:
        UnusableSchemaError: They are too many, or one leads to another for too long.
    """
    return list(_below(client, schema, fmt, set(), 0))


def _below(
    client: 'SchemaRegistryClient',
    schema: 'Schema',
    fmt: str | None,
    seen: set[tuple[str, int]],
    depth: int,
) -> Iterator[Referenced]:
    for reference in schema.references or ():
        name, subject, version = reference.name, reference.subject, reference.version
        if name is None or subject is None or version is None or (subject, version) in seen:
            continue
        seen.add((subject, version))
        if depth >= _DEEPEST or len(seen) > _MOST:
            raise UnusableSchemaError('refers to other schemas without end')
        registered = client.get_version(subject, version, deleted=True, fmt=fmt)
        yield from _below(client, registered.schema, fmt, seen, depth + 1)
        yield Referenced(name, text_of(registered.schema))
