"""Schemas that others have written with: whether they can be read, and safely.

A schema comes from the registry by an id in a record, so that it can be anything. fastavro would
read for ever, or end the process, with some kinds of schema; they are refused before the first
value is read, and so is what Avro's resolution cannot read as the message type.
"""

import json
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ros2_kafka_bridge.formats.registry import NO_SCHEMA, text_of

if TYPE_CHECKING:
    from ros2_kafka_bridge.formats.registry import Registry

Types = Mapping[str, Any]
"""The named types of a schema, by full name."""

_PROMOTED: Final = {
    'int': frozenset({'long', 'float', 'double'}),
    'long': frozenset({'float', 'double'}),
    'float': frozenset({'double'}),
    'string': frozenset({'bytes'}),
    'bytes': frozenset({'string'}),
}
_RECORDS: Final = frozenset({'error', 'record'})
_NAMED: Final = frozenset({'enum', 'fixed', 'record'})
_MOST_WITHOUT_BYTES: Final = 100


class Version(NamedTuple):
    """What is known of a schema.

    Args:
        problem: Why nothing that was written with it can be read; None where it can.
        ours: Whether it is the schema of the message type as it is here.
        writer: The schema as fastavro reads with it.
    """

    problem: str | None
    ours: bool = False
    writer: Any = None


def schema_faults() -> tuple[type[Exception], ...]:
    """What fastavro raises for a value that is not of its schema."""
    from fastavro.read import SchemaResolutionError  # noqa: PLC0415 -- of an extra

    return (
        ArithmeticError,
        EOFError,
        LookupError,
        MemoryError,
        RecursionError,
        SchemaResolutionError,
        TypeError,
        ValueError,
    )


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
        return Version(None, ours=True, writer=parse_schema(ours))
    types: dict[str, Any] = {}
    parsed = [parse_schema(document, types) for document in documents][-1]
    danger = _danger(parsed, types, (), {}, set())
    if danger:
        return Version(danger)
    our_types: dict[str, Any] = {}
    reader = parse_schema(ours, our_types)
    mismatch = next(_mismatches(parsed, reader, types, our_types, '$'), None)
    return Version(mismatch, writer=parsed)


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


def _mismatches(
    writer: Any, reader: Any, writers: Types, readers: Types, path: str
) -> Iterator[str]:
    """Where Avro's resolution cannot read one schema as the other."""
    writer, reader = _resolved(writer, writers), _resolved(reader, readers)
    if isinstance(writer, list):
        # Which of them it is, only a value tells.
        some = [_resolved(one, writers) for one in writer]
        branches = [list(_mismatches(one, reader, writers, readers, path)) for one in some]
        # fastavro takes a record of the same short name without a look at its package.
        alike = [found for one, found in zip(some, branches, strict=True) if _alike(one, reader)]
        if all(branches) or any(alike):
            yield from next(filter(None, alike), branches[0])
        return
    written, wanted = _kind(writer), _kind(reader)
    if written == wanted == 'record' and _is_same(writer, reader, path):
        theirs = {field['name']: field['type'] for field in writer['fields']}
        for field in reader['fields']:
            place = f'{path}.{field["name"]}'
            if field['name'] in theirs:
                their = theirs[field['name']]
                yield from _mismatches(their, field['type'], writers, readers, place)
            elif 'default' not in field:
                yield f'has no {place[2:]}, and {wanted} {reader["name"]} has no default for it'
    elif written == wanted == 'array':
        yield from _mismatches(writer['items'], reader['items'], writers, readers, f'{path}[]')
    elif not _is_read(writer, reader):
        yield f'does not fit: {path}: expected {_shown(reader)}, the schema has {_shown(writer)}'


def _is_same(writer: Any, reader: Any, path: str) -> bool:
    """Whether a record is the one that is read.

    Avro looks at the short name alone, and any record of it passes, because every field of ours
    has a default. The message type itself has to be the same, but for a writer without a
    namespace; within it, a package that was renamed shows by its fields.
    """
    if writer['name'] == reader['name'] or _short(writer) != _short(reader):
        return bool(writer['name'] == reader['name'])
    if path == '$':
        return '.' not in writer['name']
    ours = {field['name'] for field in reader['fields']}
    return any(field['name'] in ours for field in writer['fields'])


def _alike(writer: Any, reader: Any) -> bool:
    return _kind(writer) == _kind(reader) == 'record' and _short(writer) == _short(reader)


def _is_read(writer: Any, reader: Any) -> bool:
    written, wanted = _kind(writer), _kind(reader)
    if written == wanted == 'record':
        return False
    if written in _NAMED:
        same = written == wanted and _short(writer) == _short(reader)
        return same and (written != 'fixed' or writer['size'] == reader['size'])
    return written == wanted or wanted in _PROMOTED.get(written, ())


def _resolved(schema: Any, types: Types) -> Any:
    return types.get(schema, schema) if isinstance(schema, str) else schema


def _kind(schema: Any) -> str:
    return schema if isinstance(schema, str) else str(schema['type'])


def _short(schema: Any) -> str:
    return str(schema['name']).rpartition('.')[2]


def _shown(schema: Any) -> str:
    kind = _kind(schema)
    return f'{kind} {schema["name"]}' if kind in _NAMED else kind


def reader_of(ours: dict[str, Any]) -> Any:
    """The schema of the message type as fastavro reads other versions with it.

    fastavro fills in the default of a field that the writer did not have as it stands in the
    schema, and Avro spells bytes there as text. Here the defaults stand as they are read, so
    that nothing is left to mend in a value.

    Args:
        ours: The schema, as JSON has it.
    """
    from fastavro import parse_schema  # noqa: PLC0415 -- of an extra

    types: dict[str, Any] = {}
    reader = parse_schema(ours, types)
    for schema in types.values():
        for field in schema.get('fields', ()):
            if 'default' in field:
                field['default'] = _read_as(field['type'], field['default'], types)
    return reader


def _read_as(schema: Any, default: Any, types: Types) -> Any:
    """A default as fastavro reads such a value."""
    match _kind(_resolved(schema, types)):
        case 'array':
            return [_read_as(schema['items'], item, types) for item in default]
        case 'bytes':
            return default.encode('latin-1')
        case 'fixed':
            return Decimal(int.from_bytes(default.encode('latin-1'), 'big'))
        case _:
            return default
