"""Avro's resolution: how a value of another schema is read as the message type.

fastavro tells records apart by their short names alone, and puts the default of a field that the
writer lacks into each item of a list. So it reads with a schema that is made for one writer: each
pair of records that belong together has a name of its own there, and what the writer lacks is
left out. The structs of the message type have its default, one for all items.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.formats.avro.schema import FILLER

Types = Mapping[str, Any]
"""The named types of a schema, by full name."""

_PROMOTED: Final = {
    'int': frozenset({'long', 'float', 'double'}),
    'long': frozenset({'float', 'double'}),
    'float': frozenset({'double'}),
    'string': frozenset({'bytes'}),
    'bytes': frozenset({'string'}),
}
_NAMED: Final = frozenset({'enum', 'fixed', 'record'})


class _Fault(NamedTuple):
    """Where one schema cannot be read as another.

    Args:
        path: Of the field, as `.pose.x`; empty for the whole.
        said: What is wrong there.
        missing: Whether the writer does not have the field.
    """

    path: str
    said: str
    missing: bool = False

    def within(self, path: str) -> '_Fault':
        return self._replace(path=path + self.path)

    def __str__(self) -> str:
        if self.missing:
            return f'has no {self.path.removeprefix(".")}, and {self.said}'
        return f'does not fit: ${self.path}: {self.said}'


@dataclass(frozen=True, slots=True)
class Resolution:
    """Between the schemas of one writer and those of the message type, as fastavro parses them.

    Two records are compared once: a schema of some kilobytes can have billions of ways to them.

    Args:
        writers: The types of the writer.
        readers: Those of the message type.
        skipped: Types of fields that only the writer has, once `reader_for` is made.
    """

    writers: Types
    readers: Types
    skipped: list[Any] = field(default_factory=list)
    _faults: dict[tuple[str, str], _Fault | None] = field(default_factory=dict)
    _names: dict[tuple[str, str], str] = field(default_factory=dict)

    def mismatch(self, writer: Any, reader: Any) -> str | None:
        """Tell why no value of the writer is one of the message type; None where some may be."""
        fault = self._fault(writer, reader, is_root=True)
        return None if fault is None else str(fault)

    def reader_for(self, writer: Any, reader: Any) -> Any:
        """Make the schema to read with, where nothing mismatches: what both of them have."""
        written, wanted = _resolved(writer, self.writers), _resolved(reader, self.readers)
        if isinstance(written, list):
            return self._reader_for_union(written, wanted)
        match _kind(wanted):
            case 'record':
                return self._named(written, wanted, lambda: self._fields_for(written, wanted))
            case 'array':
                return {
                    'type': 'array',
                    'items': self.reader_for(written['items'], wanted['items']),
                }
            case 'fixed':
                return self._named(written, wanted, lambda: {'size': wanted['size']})
            case kind:
                return kind

    def _reader_for_union(self, written: list[Any], wanted: Any) -> Any:
        some = [_resolved(one, self.writers) for one in written]
        # The alias of a record without a package is taken for one of any package: it comes last.
        some.sort(key=lambda one: _kind(one) in _NAMED and '.' not in one['name'])
        made: list[Any] = []
        for one in some:
            if self._fault(one, wanted) is None:
                schema = self.reader_for(one, wanted)
                made += [] if schema in made else [schema]
        return made[0] if len(made) == 1 else made

    def _named(self, written: Any, wanted: Any, more: Callable[[], dict[str, Any]]) -> Any:
        pair = (written['name'], wanted['name'])
        if pair in self._names:
            return self._names[pair]
        name = self._names[pair] = f'As{len(self._names)}'
        return {'type': _kind(wanted), 'name': name, 'aliases': [written['name']], **more()}

    def _fields_for(self, written: Any, wanted: Any) -> dict[str, Any]:
        theirs, ours = _types_of_fields(written), _types_of_fields(wanted)
        self.skipped.extend(kind for name, kind in theirs.items() if name not in ours)
        fields = (
            {'name': name, 'type': self.reader_for(theirs[name], kind)}
            for name, kind in ours.items()
            if name in theirs
        )
        return {'fields': list(fields)}

    def skips_lists(self) -> bool:
        """Whether a field that is skipped may hold a list of any length."""
        return any(_holds_list(kind, self.writers, set()) for kind in self.skipped)

    def _fault(self, writer: Any, reader: Any, *, is_root: bool = False) -> _Fault | None:
        written, wanted = _resolved(writer, self.writers), _resolved(reader, self.readers)
        if isinstance(written, list):
            return self._fault_of_union(written, wanted, is_root=is_root)
        kinds = (_kind(written), _kind(wanted))
        if kinds == ('record', 'record') and _is_same(written, wanted, is_root=is_root):
            pair = (written['name'], wanted['name'])
            if pair not in self._faults:
                self._faults[pair] = next(
                    self._faults_of_record(written, wanted, is_root=is_root), None
                )
            return self._faults[pair]
        if kinds == ('array', 'array'):
            fault = self._fault(written['items'], wanted['items'])
            return fault and fault.within('[]')
        if _is_read(written, wanted):
            return None
        return _Fault('', f'expected {_shown(wanted)}, the schema has {_shown(written)}')

    def _fault_of_union(self, written: list[Any], wanted: Any, *, is_root: bool) -> _Fault | None:
        """Which of them it is, only a value tells."""
        some = [_resolved(one, self.writers) for one in written]
        faults = [self._fault(one, wanted, is_root=is_root) for one in some]
        # A record of the same short name is meant for ours: it has to be read, too.
        alike = [fault for one, fault in zip(some, faults, strict=True) if _alike(one, wanted)]
        found = next(filter(None, alike), None)
        return found or (faults[0] if faults and all(faults) else None)

    def _faults_of_record(self, written: Any, wanted: Any, *, is_root: bool) -> Iterator[_Fault]:
        theirs = _types_of_fields(written)
        if is_root and _is_disjoint(theirs, _types_of_fields(wanted)):
            # All of it would come from the defaults.
            yield _Fault('', f'no field of record {written["name"]} is one of {wanted["name"]}')
        for ours in wanted['fields']:
            place = f'.{ours["name"]}'
            if ours['name'] in theirs:
                fault = self._fault(theirs[ours['name']], ours['type'])
                if fault:
                    yield fault.within(place)
            elif 'default' not in ours:
                said = f'record {wanted["name"]} has no default for it'
                yield _Fault(place, said, missing=True)


def _is_same(written: Any, wanted: Any, *, is_root: bool) -> bool:
    """Whether a record is the one that is read.

    Avro looks at the short name alone, and any record of it passes, because every field of ours
    has a default. The message type itself has to be the same, but for a writer without a
    namespace; within it, a package that was renamed shows by its fields.
    """
    if written['name'] == wanted['name'] or _short(written) != _short(wanted):
        return bool(written['name'] == wanted['name'])
    if is_root:
        return '.' not in written['name']
    return not _types_of_fields(wanted).keys().isdisjoint(_types_of_fields(written))


def _is_disjoint(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> bool:
    """Whether both have fields, and none in common."""
    some, others = theirs.keys() - {FILLER}, ours.keys() - {FILLER}
    return bool(some and others and some.isdisjoint(others))


def _is_read(written: Any, wanted: Any) -> bool:
    kind = _kind(written)
    if kind == _kind(wanted) == 'fixed':
        # A decimal of another scale is another number.
        return _short(written) == _short(wanted) and _sizes(written) == _sizes(wanted)
    if kind in _NAMED:
        return False
    return kind == _kind(wanted) or _kind(wanted) in _PROMOTED.get(kind, ())


def _sizes(fixed: Any) -> str:
    """What has to be the same of two fixed ones, as people read it."""
    size = f'{fixed["size"]} bytes'
    if fixed.get('logicalType') != 'decimal':
        return size
    return f'{size}, decimal({fixed.get("precision")}, {fixed.get("scale") or 0})'


def _alike(written: Any, wanted: Any) -> bool:
    return _kind(written) == _kind(wanted) == 'record' and _short(written) == _short(wanted)


def _types_of_fields(record: Any) -> dict[str, Any]:
    return {one['name']: one['type'] for one in record['fields']}


def _resolved(schema: Any, types: Types) -> Any:
    return types.get(schema, schema) if isinstance(schema, str) else schema


def _kind(schema: Any) -> str:
    return schema if isinstance(schema, str) else str(schema['type'])


def _short(schema: Any) -> str:
    return str(schema['name']).rpartition('.')[2]


def _shown(schema: Any) -> str:
    kind = _kind(schema)
    if kind == 'fixed':
        return f'fixed {schema["name"]} ({_sizes(schema)})'
    return f'{kind} {schema["name"]}' if kind in _NAMED else kind


def _holds_list(schema: Any, types: Types, seen: set[str]) -> bool:
    found = _resolved(schema, types)
    if isinstance(found, list):
        return any(_holds_list(one, types, seen) for one in found)
    kind = _kind(found)
    if kind != 'record':
        return kind in {'array', 'map'}
    if found['name'] in seen:
        return False
    seen.add(found['name'])
    return any(_holds_list(one, types, seen) for one in _types_of_fields(found).values())
