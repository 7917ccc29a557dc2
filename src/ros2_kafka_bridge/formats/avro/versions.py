"""Schemas that others have written with: whether they can be read, and safely.

A schema comes from the registry by an id in a record, so that it can be anything. fastavro would
read for ever, or end the process, with some kinds of schema; they are refused before the first
value is read, and so is what Avro's resolution cannot read as the message type.
"""

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ros2_kafka_bridge.formats.avro.resolution import Resolution, Types
from ros2_kafka_bridge.formats.registry import NO_SCHEMA, text_of

if TYPE_CHECKING:
    from ros2_kafka_bridge.formats.registry import Registry

_RECORDS: Final = frozenset({'error', 'record'})
_MOST_WITHOUT_BYTES: Final = 100

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

WRAPPED: Final = 'value'
"""The field in which the value is, where it is of another schema."""


class Version(NamedTuple):
    """What is known of a schema.

    Args:
        problem: Why nothing that was written with it can be read; None where it can.
        writer: The schema as fastavro reads with it.
        reader: What it reads it as; None where it is the schema of the message type itself. Else
            both are records with the one field `WRAPPED`.
    """

    problem: str | None
    writer: Any = None
    reader: Any = None


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
    versions = reversed(client.get_versions(subject))
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
            text = text_of(schema)
            kind = schema.schema_type or 'AVRO'
            if kind != 'AVRO':
                return Version(f'is a schema of {kind}, and the route reads avro')
            rule = _rule_for_readers(schema.rule_set)
            if rule:
                return Version(f'has the rule {rule} for its readers: none is followed')
            texts = dict.fromkeys([*_referenced(registry.client, schema, set()), text])
        return _looked_at(list(texts), ours)
    except RecursionError:
        return Version('is nested too deeply')


def _referenced(client: Any, schema: Any, seen: set[tuple[str, int]]) -> Iterator[str]:
    """The texts of the schemas that a schema refers to, each behind those that it needs."""
    for reference in schema.references or ():
        place = (reference.subject, reference.version)
        if place in seen:
            continue
        seen.add(place)
        registered = client.get_version(*place, deleted=True)
        yield from _referenced(client, registered.schema, seen)
        yield text_of(registered.schema)


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
    except (SchemaParseException, ArithmeticError, LookupError, TypeError, ValueError) as error:
        # fastavro passes over some mistakes, such as a name that is no text.
        return Version(f'is no Avro schema: {str(error)[:500]}')


def _compared(documents: list[Any], ours: dict[str, Any]) -> Version:
    from fastavro import parse_schema  # noqa: PLC0415 -- of an extra

    if documents[-1] == ours:
        return Version(None, parse_schema(ours))
    types: dict[str, Any] = {}
    *others, document = documents
    for other in others:
        parse_schema(other, types)
    wrapped: Any = parse_schema(_wrapped(document), types)
    parsed = wrapped['fields'][0]['type']
    danger = _danger(parsed, types, (), {}, set())
    if danger:
        return Version(danger)
    _leave_logical_types(parsed, types)
    our_types: dict[str, Any] = {}
    reader = parse_schema(ours, our_types)
    resolution = Resolution(types, our_types)
    mismatch = resolution.mismatch(parsed, reader)
    if mismatch:
        return Version(mismatch)
    read_as = resolution.reader_for(parsed, reader)
    return Version(None, wrapped, parse_schema(_wrapped(read_as)))


def _wrapped(schema: Any) -> dict[str, Any]:
    """A record of one value takes no more bytes than that.

    fastavro forgets the types of other schemas where a schema is only a name of one, or a choice
    of several, as for a topic with records of several types.
    """
    return {
        'type': 'record',
        # Without a package: the types in it would be of that.
        'name': 'Ros2Wrapped',
        'fields': [{'name': WRAPPED, 'type': schema}],
    }


def _danger(
    schema: Any, types: Types, around: tuple[str, ...], known: dict[str, int], done: set[str]
) -> str | None:
    """Why no value of a schema may be read, None where it may.

    Args:
        schema: As fastavro has parsed it.
        types: All that have a name.
        around: The types that the schema stands in.
        known: What `_without_bytes` has counted.
        done: The types that were looked at.
    """
    if isinstance(schema, list):
        inner = schema
    elif isinstance(schema, str):
        if schema in around:
            return f'has the type {schema} within itself, as no message type does'
        if schema not in types or schema in done:
            return None
        done.add(schema)
        return _danger(types[schema], types, around, known, done)
    elif schema['type'] in _RECORDS:
        around = (*around, schema['name'])
        inner = [field['type'] for field in schema['fields']]
        if sum(_without_bytes(one, types, known) for one in inner) > _MOST_WITHOUT_BYTES:
            return f'has {_MOST_WITHOUT_BYTES} fields without bytes in {schema["name"]}, and more'
    elif schema['type'] == 'array' and _without_bytes(schema['items'], types, known):
        return 'has an array of items without bytes: it could be of any length'
    else:
        inner = [schema[key] for key in ('items', 'values') if key in schema]
    found = (_danger(one, types, around, known, done) for one in inner)
    return next((danger for danger in found if danger), None)


def _without_bytes(schema: Any, types: Types, known: dict[str, int]) -> int:
    """How much is read of a value that takes no bytes; 0 where every value takes some."""
    if isinstance(schema, list):
        return 0
    kind = schema if isinstance(schema, str) else schema['type']
    if kind in types:
        return _without_bytes(types[kind], types, known)
    if kind in _RECORDS:
        name = schema['name']
        if name not in known:
            # A type within itself is refused where the walk comes to it.
            known[name] = 0
            inner = [_without_bytes(field['type'], types, known) for field in schema['fields']]
            known[name] = 1 + sum(inner) if all(inner) else 0
        return known[name]
    return int(schema['size'] == 0 if kind == 'fixed' else kind == 'null')


def _leave_logical_types(schema: Any, types: Types) -> None:
    """Have every value read as what it is underneath, as Avro allows.

    fastavro makes dates and times of numbers, which no message has, and needs minutes for a
    decimal of a million bytes. A fixed one is the uint64 of ours, or does not fit.
    """
    for one in (schema, *types.values()):
        _leave_logical_type(one)


def _leave_logical_type(schema: Any) -> None:
    if isinstance(schema, list):
        for one in schema:
            _leave_logical_type(one)
    elif isinstance(schema, dict):
        if schema['type'] != 'fixed':
            schema.pop('logicalType', None)
        inner = [schema[key] for key in ('items', 'values') if key in schema]
        inner += [one['type'] for one in schema.get('fields', ())]
        _leave_logical_type(inner)
