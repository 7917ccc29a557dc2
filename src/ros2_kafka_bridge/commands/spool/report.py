"""What waits on disk for Kafka: what `spool` shows. Nothing is touched by looking."""

import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console

from ros2_kafka_bridge.commands.screen import screen, show_line, show_table, waiting
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.text import count as counted
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.spool.health import kind_of
from ros2_kafka_bridge.spool.lock import lock_of
from ros2_kafka_bridge.spool.look import SpoolContents, look, spools_in
from ros2_kafka_bridge.spool.rows import Row, size_of
from ros2_kafka_bridge.spool.store import file_of

_PREVIEW_CHARS: Final = 60
_UNITS: Final = ('kB', 'MB', 'GB', 'TB')
_AGES: Final = ((86_400.0, 'd'), (3_600.0, 'h'), (60.0, 'min'))


class SpoolOptions(NamedTuple):
    """What is to be shown.

    Args:
        messages: How many of the messages of each spool.
        values: Whether with the beginning of their values.
        as_json: For programs instead of people.
    """

    messages: int
    values: bool
    as_json: bool


class _Place(NamedTuple):
    """A spool to look at; `route` is the route that has it, where a configuration says so."""

    path: Path
    route: str = ''


def report(path: Path, options: SpoolOptions) -> int:
    """Look at the spools of a configuration, of a directory, or at one, and print what they hold.

    Returns:
        0 when all that is there is well, 1 when something is damaged or gone with messages in it,
        2 when something cannot be read or is no spool.

    Raises:
        ConfigError: There is nothing to look at, or the configuration is wrong.
    """
    places, none = _places(path)
    with waiting('Looking at the spools'):
        found = [(place, look(place.path, options.messages)) for place in places]
    if options.as_json:
        shown = [_as_json(place, contents, options) for place, contents in found]
        sys.stdout.write(json.dumps({'spools': shown}, indent=2) + '\n')
    else:
        _show(screen(), found, none, options)
    for contents in (contents for _, contents in found if contents.problem):
        sys.stderr.write(f'{contents.path}: {contents.problem}\n')
    if any(contents.problem for _, contents in found):
        return 2
    return 1 if any(contents.damage for _, contents in found) else 0


# What to look at


def _places(path: Path) -> tuple[list[_Place], str]:
    """The spools that are meant, and what to say where there are none."""
    try:
        if path.is_dir():
            return [
                _Place(file) for file in spools_in(path)
            ], f'{path}: no spool in this directory'
        if not path.exists() and not lock_of(path).exists():
            raise ConfigError([f'{path}: there is no such file or directory'])
        if not _is_configuration(path):
            return [_Place(path)], ''
    except OSError as error:
        raise ConfigError([f'{path}: cannot be read: {error.strerror}']) from error
    return _places_of_configuration(path), f'{path}: no route has a spool'


def _is_configuration(path: Path) -> bool:
    if path.suffix in {'.yaml', '.yml'}:
        return True
    if '.spool' in path.suffixes or not path.is_file():
        return False
    return kind_of(path) == 'other'


def _places_of_configuration(path: Path) -> list[_Place]:
    from ros2_kafka_bridge.config.file import load  # noqa: PLC0415 (heavy, and seldom needed)

    config = load(path, os.environ)
    return [
        _Place(file_of(Path(route.spool.path), config.name, route.name), route.name)
        for route in config.routes
        if route.spool is not None
    ]


# For people


def _show(
    console: Console,
    found: Sequence[tuple[_Place, SpoolContents]],
    none: str,
    options: SpoolOptions,
) -> None:
    if not found:
        show_line(console, none)
    by_directory: dict[Path, list[tuple[_Place, SpoolContents]]] = {}
    for place, contents in found:
        if not contents.problem:
            by_directory.setdefault(place.path.parent, []).append((place, contents))
    for directory, inside in by_directory.items():
        _show_spools(console, directory, inside)
    for _, contents in found:
        if contents.damage:
            text = _damage(contents) if contents.exists else _what_is_gone(contents)
            show_line(console, f'{contents.path} {text}', 'bold red')
    for _, contents in found:
        if contents.rows:
            _show_rows(console, contents, options)


def _damage(contents: SpoolContents) -> str:
    lost = f', {_lost(contents)} lost' if contents.lost != 0 else ''
    said = f'is damaged: {contents.damage}{lost}'
    return f'{said}. What can be read is delivered when a bridge opens it.'


def _what_is_gone(contents: SpoolContents) -> str:
    if contents.is_open:
        return (
            f'is missing, and a process has it open: {_lost(contents)} in it, by its lock file, '
            'are lost if that ends before it has delivered them'
        )
    return (
        f'is missing: {_lost(contents)} are lost, by its lock file; mount its disk, or put it '
        'back, before a bridge begins a new one'
    )


def _lost(contents: SpoolContents) -> str:
    if contents.lost is None:
        return 'an unknown number of messages'
    return f'{"" if contents.certain else "at least "}{counted(contents.lost, "message")}'


def _show_spools(
    console: Console, directory: Path, found: Sequence[tuple[_Place, SpoolContents]]
) -> None:
    columns = ['spool', '#messages', '#size', 'oldest', 'newest', 'way', 'state']
    rows = [
        [
            [printable(contents.path.name)],
            [str(contents.messages)],
            [_size(contents.bytes)],
            _when(contents.oldest_ns),
            _when(contents.newest_ns),
            _way(place, contents),
            list(_state(contents)),
        ]
        for place, contents in found
    ]
    show_table(console, f'Spools in {directory}', columns, rows)


def _way(place: _Place, contents: SpoolContents) -> list[str]:
    route = [place.route] if place.route else []
    ends = [printable(contents.ros_topic) or '?', f'-> {printable(contents.kafka_topic)}']
    return route + (ends if contents.kafka_topic else [])


def _state(contents: SpoolContents) -> Iterator[str]:
    if not contents.exists:
        yield 'MISSING' if contents.damage else 'not there'
    else:
        yield 'DAMAGED' if contents.damage else 'well'
    if contents.is_open is None:
        yield 'not known who has it'
    elif contents.exists or contents.is_open:
        yield f'open (pid {contents.pid or "unknown"})' if contents.is_open else 'not open'
    if not contents.exists:
        return
    if contents.dead_letters:
        yield counted(contents.dead_letters, 'dead letter')
    yield f'version {contents.version}'
    yield f'file {_size(contents.file_bytes)}'


def _show_rows(console: Console, contents: SpoolContents, options: SpoolOptions) -> None:
    columns = ['#number', 'taken', 'key', 'publisher', '#seq', '#size']
    columns += ['value'] * options.values
    rows = [
        [
            [str(row.number)],
            [_time(row.taken_ns), *['dead letter'] * row.dead],
            [_text(row.record.key)],
            [row.gid.hex() or '-'],
            [str(row.seq) if row.seq else '-'],
            [_size(size_of(row.record))],
            *[[_text(row.record.value)]] * options.values,
        ]
        for row in contents.rows
    ]
    title = f'{printable(contents.path.name)}: the first {len(rows)} of {contents.messages}'
    show_table(console, title, columns, rows)


def _when(time_ns: int | None) -> list[str]:
    if time_ns is None:
        return []
    return [_time(time_ns), _age((time.time_ns() - time_ns) / 1e9)]


def _time(time_ns: int) -> str:
    try:
        return f'{datetime.fromtimestamp(time_ns / 1e9).astimezone():%Y-%m-%d %H:%M:%S}'
    except (OverflowError, ValueError, OSError):  # no clock says so
        return str(time_ns)


def _age(age_s: float) -> str:
    if age_s < 0:
        return 'in the future'
    for length_s, name in _AGES:
        if age_s >= length_s:
            return f'{age_s / length_s:.0f} {name} ago'
    return f'{age_s:.0f} s ago'


def _size(size_bytes: float | None) -> str:
    if size_bytes is None:
        return '?'
    if size_bytes < 1000:
        return f'{size_bytes:.0f} B'
    for unit in _UNITS:
        size_bytes /= 1000
        if size_bytes < 1000 or unit == _UNITS[-1]:
            return f'{size_bytes:.1f} {unit}'
    raise AssertionError


def _text(data: bytes | None) -> str:
    if data is None:
        return 'null'
    text = data[: 4 * _PREVIEW_CHARS].decode('utf-8', 'backslashreplace')
    more = '...' if len(text) > _PREVIEW_CHARS or len(data) > 4 * _PREVIEW_CHARS else ''
    return printable(text[:_PREVIEW_CHARS]) + more


# For programs


def _as_json(place: _Place, contents: SpoolContents, options: SpoolOptions) -> Mapping[str, Any]:
    return {
        **vars(contents),
        'path': str(contents.path),
        'route': place.route,
        'rows': [_row_as_json(row, options) for row in contents.rows],
    }


def _row_as_json(row: Row, options: SpoolOptions) -> Mapping[str, Any]:
    value = {'value': _text(row.record.value)} if options.values else {}
    return {
        'number': row.number,
        'taken_ns': row.taken_ns,
        'dead_letter': row.dead,
        'topic': row.record.topic,
        'key': _text(row.record.key),
        'gid': row.gid.hex(),
        'seq': row.seq,
        'bytes': size_of(row.record),
        **value,
    }
