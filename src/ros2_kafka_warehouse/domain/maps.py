"""Readers of the public formats: MAPD `.map` and `.task`, MovingAI `.map` and `.scen`.

MAPD (Ma et al. 2017): a map begins with four lines, rows and columns, number of endpoints, number
of robots, number of steps, which some collections leave out. Then the rows: `@` is a wall, `e`
an endpoint of tasks, `r` the start of a robot, `.` the rest. A task file begins with the number of
tasks, which some leave out, then one task a line: step of release, endpoint of the pick-up,
endpoint of the delivery, 0, 0; endpoints are counted row by row from 0.

MovingAI: a map begins with `type octile`, `height`, `width` and `map`; `.`, `G` and `S` can be
driven on. A line of a scenario: bucket, map, its width and height, start x and y, goal x and y,
length of the way.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from ros2_kafka_warehouse.messages.message import Cell

MAPD_SYMBOLS = frozenset('.er@')
MOVINGAI_SYMBOLS = frozenset('.GSW@OT')
MOVINGAI_FREE = frozenset('.GS')
HEADER_LINES = 4


class MapError(Exception):
    """A file that is not what its format says: which file, which line, what is wrong there."""

    def __init__(self, path: Path, line: int, what: str) -> None:
        super().__init__(f'{path}:{line}: {what}' if line else f'{path}: {what}')


class FloorPlan(NamedTuple):
    """What a map file holds.

    Attributes:
        rows: `@` for a wall, `e`, `r` and `.` as in MAPD files.
        endpoints: Where tasks begin and end, counted row by row; of a MovingAI map: all free
            cells.
        starts: Where robots start, row by row; of a MovingAI map: none.
    """

    rows: tuple[str, ...]
    endpoints: tuple[Cell, ...]
    starts: tuple[Cell, ...]


class Job(NamedTuple):
    """A task of the benchmark: from `release` on something is to be carried."""

    release: int
    pickup: Cell
    delivery: Cell


class Trip(NamedTuple):
    """A line of a scenario: one way from a cell to another."""

    start: Cell
    goal: Cell


def read_map(path: Path) -> FloorPlan:
    """The floor plan of a MAPD or MovingAI map; the file itself shows which it is.

    Raises:
        MapError: The file cannot be read or is neither.
    """
    lines = _lines(path)
    if lines and lines[0].split()[:1] == ['type']:
        return _movingai_map(path, lines)
    return _mapd_map(path, lines)


def read_tasks(path: Path, endpoints: Sequence[Cell]) -> tuple[Job, ...]:
    """The tasks of a MAPD task file, in the order of the file.

    Args:
        path: The file.
        endpoints: Those of the map to which the tasks belong.

    Raises:
        MapError: The file cannot be read or breaks the format.
    """
    lines = [(number, line.split()) for number, line in enumerate(_lines(path), 1) if line.strip()]
    announced = None
    if lines and len(lines[0][1]) == 1:
        number, (count,) = lines.pop(0)
        announced = _number(path, number, count, 'the number of tasks')
    jobs = tuple(_job(path, number, fields, endpoints) for number, fields in lines)
    if announced not in (None, len(jobs)):
        raise MapError(path, 1, f'announces {announced} tasks, but the file has {len(jobs)}')
    return jobs


def read_scenario(path: Path, floor: FloorPlan) -> tuple[Trip, ...]:
    """The trips of a MovingAI scenario, in the order of the file.

    Args:
        path: The file.
        floor: The map to which the scenario belongs.

    Raises:
        MapError: The file cannot be read or breaks the format.
    """
    lines = list(enumerate(_lines(path), 1))
    if lines and lines[0][1].startswith('version'):
        lines.pop(0)
    return tuple(
        _trip(path, number, line.split(), floor) for number, line in lines if line.strip()
    )


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding='utf-8').splitlines()
    except OSError as error:
        raise MapError(path, 0, f'cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise MapError(path, 0, 'is no text file') from error


def _number(path: Path, line: int, text: str, what: str) -> int:
    try:
        number = int(text)
    except ValueError:
        raise MapError(path, line, f'{what} must be a whole number, not `{text}`') from None
    if number < 0:
        raise MapError(path, line, f'{what} must not be negative, but is {number}')
    return number


def _mapd_map(path: Path, lines: list[str]) -> FloorPlan:
    announced: dict[str, int] = {}
    first = 1
    if lines and lines[0].strip()[:1].isdigit():
        announced = _mapd_header(path, lines)
        first += HEADER_LINES
    rows = [line.strip() for line in lines[first - 1 :]]
    while rows and not rows[-1]:
        rows.pop()
    _check_rows(path, first, rows, MAPD_SYMBOLS)
    floor = FloorPlan(tuple(rows), _where(rows, 'e'), _where(rows, 'r'))
    found = {
        'rows': len(rows),
        'columns': len(rows[0]),
        'endpoints': len(floor.endpoints),
        'robots': len(floor.starts),
    }
    for line, (what, number) in zip((1, 1, 2, 3), announced.items(), strict=False):
        if found[what] != number:
            raise MapError(path, line, f'announces {number} {what}, but the map has {found[what]}')
    return floor


def _mapd_header(path: Path, lines: list[str]) -> dict[str, int]:
    if len(lines) < HEADER_LINES:
        raise MapError(path, len(lines), 'ends within its first four lines')
    size = lines[0].split(',')
    if len(size) != 2:
        raise MapError(path, 1, f'must be rows and columns, like `21,35`, not `{lines[0]}`')
    _number(path, 4, lines[3], 'the number of steps')
    return {
        'rows': _number(path, 1, size[0], 'the number of rows'),
        'columns': _number(path, 1, size[1], 'the number of columns'),
        'endpoints': _number(path, 2, lines[1], 'the number of endpoints'),
        'robots': _number(path, 3, lines[2], 'the number of robots'),
    }


def _movingai_map(path: Path, lines: list[str]) -> FloorPlan:
    if len(lines) < HEADER_LINES:
        raise MapError(path, len(lines), 'ends within its first four lines')
    size: dict[str, int] = {}
    for number, line in enumerate(lines[1:3], 2):
        name, _, value = line.partition(' ')
        if name not in ('height', 'width'):
            raise MapError(path, number, f'must be `height N` or `width N`, not `{line}`')
        size[name] = _number(path, number, value, f'the {name}')
    if lines[3].strip() != 'map' or len(size) != 2:
        raise MapError(path, HEADER_LINES, 'must be the line `map`, after `height` and `width`')
    found = [line.rstrip() for line in lines[HEADER_LINES:] if line.strip()]
    _check_rows(path, HEADER_LINES + 1, found, MOVINGAI_SYMBOLS)
    if (len(found), len(found[0])) != (size['height'], size['width']):
        raise MapError(
            path,
            2,
            f'announces {size["width"]} x {size["height"]} cells, '
            f'but the map has {len(found[0])} x {len(found)}',
        )
    rows = tuple(
        ''.join('.' if symbol in MOVINGAI_FREE else '@' for symbol in row) for row in found
    )
    return FloorPlan(rows, _where(rows, '.'), ())


def _check_rows(path: Path, first: int, rows: list[str], symbols: frozenset[str]) -> None:
    if not rows:
        raise MapError(path, first, 'the rows of the map are missing')
    for number, row in enumerate(rows, first):
        strange = next((symbol for symbol in row if symbol not in symbols), None)
        if strange is not None:
            known = ' '.join(sorted(symbols))
            raise MapError(path, number, f'`{strange}` is no symbol of a map; there are {known}')
        if len(row) != len(rows[0]):
            raise MapError(
                path, number, f'has {len(row)} cells, but the row before it has {len(rows[0])}'
            )


def _where(rows: Iterable[str], symbol: str) -> tuple[Cell, ...]:
    return tuple(
        (x, y) for y, row in enumerate(rows) for x, found in enumerate(row) if found == symbol
    )


def _job(path: Path, line: int, fields: list[str], endpoints: Sequence[Cell]) -> Job:
    if len(fields) < 3:
        raise MapError(path, line, 'must be release, pick-up, delivery, 0, 0')
    release = _number(path, line, fields[0], 'the step of the release')
    cells = []
    for text, what in zip(fields[1:3], ('the pick-up', 'the delivery'), strict=True):
        endpoint = _number(path, line, text, what)
        if endpoint >= len(endpoints):
            raise MapError(
                path, line, f'{what} is endpoint {endpoint}, but the map has {len(endpoints)}'
            )
        cells.append(endpoints[endpoint])
    return Job(release, cells[0], cells[1])


def _trip(path: Path, line: int, fields: list[str], floor: FloorPlan) -> Trip:
    if len(fields) < 8:
        raise MapError(path, line, 'must have nine fields, from the bucket to the length')
    width, height, *ends = (_number(path, line, text, 'a field') for text in fields[2:8])
    if (width, height) != (len(floor.rows[0]), len(floor.rows)):
        raise MapError(
            path,
            line,
            f'belongs to a map of {width} x {height} cells, '
            f'but the map has {len(floor.rows[0])} x {len(floor.rows)}',
        )
    for x, y in (ends[:2], ends[2:]):
        if x >= width or y >= height or floor.rows[y][x] == '@':
            raise MapError(path, line, f'{x},{y} is no free cell of the map')
    return Trip((ends[0], ends[1]), (ends[2], ends[3]))
