"""Schemas that others have written with: whether they can be read, and safely.

A schema comes from the registry by an id in a record, so that it can be anything: it is looked at
before the first value is read.
"""

import json
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ros2_kafka_bridge.formats.avro.resolution import Resolution
from ros2_kafka_bridge.formats.avro.safety import UnsafeError, check_safe, only_read
from ros2_kafka_bridge.formats.references import referenced
from ros2_kafka_bridge.formats.registry import (
    NO_SCHEMA,
    UnusableSchemaError,
    kind_of,
    text_of,
)

if TYPE_CHECKING:
    from ros2_kafka_bridge.formats.registry import Registry

FAULTS: Final = (
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    RecursionError,
    TypeError,
    ValueError,
)
"""What fastavro raises for a value that is not of its schema."""

END: Final = 'end'
"""What stands behind a value of which something may be skipped."""
END_BYTES: Final = b'\x02'

_MOST_VERSIONS: Final = 1000

WRAPPED: Final = 'value'
"""The field in which fastavro gives the value."""


class Version(NamedTuple):
    """What is known of a schema.

    Args:
        problem: Why nothing that was written with it can be read; None where it can.
        writer: The schema as fastavro reads with it, as a record with the one field `WRAPPED`.
        reader: What it reads it as, such a record, too; None where that is the same. Both end with
            the field `END` then.
        skips_lists: Whether the writer has a list of any length that is not read.
    """

    problem: str | None
    writer: Any = None
    reader: Any = None
    skips_lists: bool = False


def text_in(registry: 'Registry', subject: str, ours: dict[str, Any]) -> str | None:
    """The text of a schema as it is registered in a subject; None where it is not found.

    Some registries tell schemas apart by their spaces, so that a text which was printed for
    people is found only among the versions themselves.

    Raises:
        SchemaRegistryError: There is no such subject, or the registry refuses to answer.
    """
    # Of an extra.
    from confluent_kafka.schema_registry import Schema, SchemaRegistryError  # noqa: PLC0415

    client = registry.client
    text = json.dumps(ours)
    try:
        client.lookup_schema(subject, Schema(text, 'AVRO'))
    except SchemaRegistryError as error:
        if error.error_code != NO_SCHEMA:
            raise
    else:
        return text
    versions = sorted(client.get_versions(subject), reverse=True)[:_MOST_VERSIONS]
    texts = (client.get_version(subject, version).schema.schema_str for version in versions)
    return next((one for one in texts if one and _is_json_of(ours, one)), None)


def _is_json_of(schema: dict[str, Any], text: str) -> bool:
    try:
        return bool(json.loads(text) == schema)
    except (ValueError, RecursionError):
        return False


def version_of(registry: 'Registry', schema_id: int, ours: dict[str, Any]) -> Version:
    """Ask the registry for a schema and look at it.

    Args:
        registry: Asked for the schema, and for those that it refers to.
        schema_id: As a record names it.
        ours: The schema of the message type.

    Raises:
        DecodeError: The registry has no such schema.
        RouteError: The registry does not answer.
    """
    try:
        with registry.reading(schema_id):
            schema = registry.client.get_schema(schema_id)
            text, kind = text_of(schema), kind_of(schema)
            rule = _rule_for_readers(schema.rule_set)
            others = referenced(registry.client, schema)
        if kind != 'AVRO':
            return Version(f'is a schema of {kind}, and the route reads avro')
        if rule:
            return Version(f'has the rule {rule} for its readers: none is followed')
        texts = dict.fromkeys([*(other.text for other in others), text])
        return _looked_at(list(texts), ours)
    except UnusableSchemaError as problem:
        return Version(str(problem))
    except RecursionError:
        return Version('is nested too deeply')


def _rule_for_readers(rules: Any) -> str | None:
    """A rule for what is read, as one that decrypts it; None where there is none."""
    from confluent_kafka.schema_registry import RuleMode  # noqa: PLC0415 -- of an extra

    every = [*(rules.domain_rules or ()), *(rules.encoding_rules or ())] if rules else []
    reading = (
        rule.name
        for rule in every
        if rule.mode in {RuleMode.READ, RuleMode.WRITEREAD} and not rule.disabled
    )
    return next(reading, None)


def _looked_at(texts: list[str], ours: dict[str, Any]) -> Version:
    from fastavro.schema import SchemaParseException  # noqa: PLC0415 -- of an extra

    try:
        return _compared([json.loads(text) for text in texts], ours)
    except UnsafeError as danger:
        return Version(str(danger))
    except (SchemaParseException, ArithmeticError, LookupError, TypeError, ValueError) as error:
        # fastavro passes over some mistakes, such as a name that is no text.
        return Version(f'is no Avro schema: {str(error)[:500]}')


def _compared(documents: list[Any], ours: dict[str, Any]) -> Version:
    from fastavro import parse_schema  # noqa: PLC0415 -- of an extra

    types: dict[str, Any] = {}
    *others, document = map(only_read, documents)
    for other in others:
        parse_schema(other, types)
    known = dict(types)
    writer: Any = parse_schema(_wrapped(document), types)
    if writer == parse_schema(_wrapped(only_read(ours))):
        return Version(None, writer)
    [written] = writer['fields']
    check_safe(written['type'], types)
    our_types: dict[str, Any] = {}
    wanted = parse_schema(ours, our_types)
    resolution = Resolution(types, our_types)
    mismatch = resolution.mismatch(written['type'], wanted)
    if mismatch:
        return Version(mismatch)
    reader = resolution.reader_for(written['type'], wanted)
    return Version(
        None,
        parse_schema(_wrapped(document, ends=True), known),
        parse_schema(_wrapped(reader, ends=True)),
        resolution.skips_lists(),
    )


def _wrapped(schema: Any, *, ends: bool = False) -> dict[str, Any]:
    """A record of one value takes no more bytes than that.

    fastavro forgets the types of other schemas where a schema is only a name of one, or a choice
    of several, as for a topic with records of several types.
    """
    return {
        'type': 'record',
        # Without a package: the types in it would be of that.
        'name': 'Ros2Wrapped',
        'fields': [
            {'name': WRAPPED, 'type': schema},
            *([{'name': END, 'type': 'int'}] if ends else []),
        ],
    }
