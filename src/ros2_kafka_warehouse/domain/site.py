"""The site: its map, stations, chargers, products and robots, read from a file or made by rules.

A site file in YAML names a map file in the format of the MAPD benchmark, which stands beside it
(or a MovingAI map)::

    name: tea house
    map: tea_house.map        # rows,cols / endpoints / robots / steps, then the rows
    step_s: 0.5
    stations:
      packing-1: [41, 3]      # column, row; from 0 at the top left
    chargers: [[0, 2], [0, 9]]
    products:
      tea: {cells: [[5, 1], [9, 4]], weight_kg: 0.5, size: small}
    robots:
      carrier-1: {type: carrier, home: [0, 0]}
"""

from collections.abc import Sequence
from math import ceil, sqrt
from pathlib import Path
from random import Random
from typing import Any, Final

import msgspec

from ros2_kafka_warehouse.domain.maps import MapError, read_map
from ros2_kafka_warehouse.domain.profile_files import near_miss
from ros2_kafka_warehouse.domain.yaml_file import FileError, YamlFile, read_yaml
from ros2_kafka_warehouse.messages.message import Cell, Message

DEFAULT_SITE: Final = Path(__file__).parent.parent / 'data' / 'site.yaml'

_SHORTEST_S: Final = 0.001  # of a step
_LONGEST_S: Final = 3600.0

WALL: Final = '@'  # or a shelf


class SiteError(ValueError):
    """A site that cannot be: says which file, line and field, and what would be right."""


class Product(Message, frozen=True):
    """A product, the cells from which it can be picked, and what it takes to carry one piece."""

    name: str
    cells: tuple[Cell, ...]
    weight_kg: float = 1.0
    size: str = 'small'


class RobotPlace(Message, frozen=True):
    """A robot of the site: its type and the cell where it starts."""

    serial_number: str
    robot_type: str
    home: Cell


class Site(Message, frozen=True):
    """What does not change while the warehouse runs.

    Attributes:
        rows: The map, one text a row, as in the files of the MAPD benchmark: `@` is a wall or a
            shelf, anything else can be driven on (`e`: a stock cell, `r`: a home of a robot,
            `.`: the rest).
        step_s: Seconds that a step of the fleet takes.
    """

    name: str
    rows: tuple[str, ...]
    stations: dict[str, Cell]
    products: dict[str, Product]
    robots: dict[str, RobotPlace]
    chargers: tuple[Cell, ...] = ()
    cell_m: float = 1.0
    step_s: float = 0.5

    def is_on_map(self, cell: Cell) -> bool:
        """Whether the map has such a cell, free or not."""
        column, row = cell
        return 0 <= row < len(self.rows) and 0 <= column < len(self.rows[row])


class _ProductEntry(msgspec.Struct, forbid_unknown_fields=True):
    cells: tuple[Cell, ...]
    weight_kg: float = 1.0
    size: str = 'small'


class _RobotEntry(msgspec.Struct, forbid_unknown_fields=True):
    type: str
    home: Cell


class _SiteFile(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    map: str
    stations: dict[str, Any]
    products: dict[str, Any]
    robots: dict[str, Any]
    chargers: tuple[Cell, ...] = ()
    cell_m: float = 1.0
    step_s: float = 0.5


def read_site(path: Path = DEFAULT_SITE) -> Site:
    """The site of a file, checked: every place is on the map, free, and can be driven to.

    Raises:
        SiteError: A file cannot be read, or what it says cannot be.
    """
    try:
        file = read_yaml(path)
        site = _site(file)
        _check(file, site)
    except (FileError, MapError) as error:
        raise SiteError(str(error)) from None
    return site


def choose_site(path: Path | None, robots: int | None, seed: int = 0) -> Site:
    """The site of a file, with its first robots only if so many are asked for; or one made so.

    Args:
        path: None for a site that is made for the robots, or that of the package.
        robots: How many; None for all of the site.
        seed: Of the made site.

    Raises:
        SiteError: The site cannot be, or has fewer robots.
    """
    if robots is None:
        return read_site(path or DEFAULT_SITE)
    if path is None:
        return make_site(robots, seed)
    site = read_site(path)
    if robots > len(site.robots):
        raise SiteError(
            f'{path}: has {len(site.robots)} robots, not {robots}: list more, or ask for fewer'
        )
    names = list(site.robots)[:robots]
    return msgspec.structs.replace(site, robots={name: site.robots[name] for name in names})


def check_robot_types(site: Site, types: Sequence[str], path: Path | None = None) -> None:
    """Check that the execution profiles know the type of each robot.

    Raises:
        SiteError: They do not.
    """
    for name, robot in site.robots.items():
        if robot.robot_type not in types:
            raise SiteError(
                f'{path or site.name}: robots.{name}.type: the execution profiles have no type '
                f"'{robot.robot_type}'; {near_miss(robot.robot_type, list(types))}"
            )


def _site(file: YamlFile) -> Site:
    head = file.value(_SiteFile)
    map_path = file.path.parent / head.map
    if not map_path.is_file():
        raise file.error(f'there is no file {map_path}', 'map')
    products = {name: file.value(_ProductEntry, 'products', name) for name in head.products}
    robots = {name: file.value(_RobotEntry, 'robots', name) for name in head.robots}
    stations: dict[str, Cell] = {
        name: file.value(Cell, 'stations', name) for name in head.stations
    }
    return Site(
        name=head.name,
        rows=read_map(map_path).rows,
        stations=stations,
        products={
            name: Product(name, entry.cells, entry.weight_kg, entry.size)
            for name, entry in products.items()
        },
        robots={name: RobotPlace(name, entry.type, entry.home) for name, entry in robots.items()},
        chargers=head.chargers,
        cell_m=head.cell_m,
        step_s=head.step_s,
    )


def _check(file: YamlFile, site: Site) -> None:
    for name in ('stations', 'products', 'robots'):
        if not getattr(site, name):
            raise file.error('must hold at least one', name)
    _check_measures(file, site)
    for name, product in site.products.items():
        if not product.cells:
            raise file.error('must name at least one cell', 'products', name, 'cells')
    homes: dict[Cell, str] = {}
    for name, robot in site.robots.items():
        other = homes.setdefault(robot.home, name)
        if other != name:
            raise file.error(f'{other} starts there, too', 'robots', name, 'home')
    _check_places(file, site)


def _check_measures(file: YamlFile, site: Site) -> None:
    for name in ('cell_m', 'step_s'):
        if getattr(site, name) <= 0:
            raise file.error('must be more than 0', name)
    if not _SHORTEST_S <= site.step_s <= _LONGEST_S:
        raise file.error(f'must be from {_SHORTEST_S:g} to {_LONGEST_S:g} (seconds)', 'step_s')
    for name, product in site.products.items():
        if product.weight_kg <= 0:
            raise file.error('must be more than 0', 'products', name, 'weight_kg')


def _check_places(file: YamlFile, site: Site) -> None:
    places: list[tuple[Cell, tuple[str | int, ...]]] = [
        *((cell, ('stations', name)) for name, cell in site.stations.items()),
        *((cell, ('chargers', number)) for number, cell in enumerate(site.chargers)),
        *((robot.home, ('robots', name, 'home')) for name, robot in site.robots.items()),
        *(
            (cell, ('products', name, 'cells', number))
            for name, product in site.products.items()
            for number, cell in enumerate(product.cells)
        ),
    ]
    reached = _reached(site.rows, places[0][0])
    for (column, row), field in places:
        if not site.is_on_map((column, row)):
            raise file.error(f'{column}, {row} (column, row) is not on the map', *field)
        if site.rows[row][column] == WALL:
            raise file.error(f'{column}, {row} (column, row) is a wall or a shelf', *field)
        if (column, row) not in reached:
            first = '.'.join(str(part) for part in places[0][1])
            raise file.error(f'no way leads there from {first}', *field)


def _reached(rows: tuple[str, ...], start: Cell) -> set[Cell]:
    free = {
        (column, row)
        for row, text in enumerate(rows)
        for column, mark in enumerate(text)
        if mark != WALL
    }
    reached = {start} & free
    queue = list(reached)
    for column, row in queue:
        for cell in ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)):
            if cell in free and cell not in reached:
                reached.add(cell)
                queue.append(cell)
    return reached


# Sites made by rules.

_WEST: Final = 4  # open columns on the left: homes, chargers and lanes
_EAST: Final = 4  # on the right: stations and lanes
_SHELF: Final = 7  # cells of a shelf block in a row
_SIZES: Final = (('small', 0.2, 5.0), ('medium', 3.0, 20.0), ('large', 15.0, 60.0))


def make_site(
    robots: int = 12,
    seed: int = 0,
    *,
    shelf_rows: int | None = None,
    shelf_columns: int | None = None,
) -> Site:
    """A site for so many robots: shelf blocks, aisles two wide, stations right, chargers left.

    No cell of it is the only way to another: one robot that stands still cuts nothing off.

    Args:
        robots: How many, from 1; every third one is a hauler.
        seed: Of what lies where.
        shelf_rows: Rows of shelf blocks; from the number of robots if not given.
        shelf_columns: Shelf blocks in a row.
    """
    random = Random(seed)  # noqa: S311 - a warehouse that can be made again, not a secret
    scale = sqrt(max(robots, 1) / 25)
    shelf_rows = shelf_rows or max(2, ceil(5 * scale))
    shelf_columns = shelf_columns or max(2, ceil(4 * scale))
    rows = _rows(shelf_rows, shelf_columns)
    height, width = len(rows), len(rows[0])
    chargers = _spread(0, height, max(2, ceil(robots / 4) + 1))
    stations = _spread(width - 1, height, max(2, min(height // 3, round(robots / 3))))
    homes = _homes(rows, {*chargers, *stations}, robots)
    names = [f'product-{number + 1:03d}' for number in range(4 * shelf_rows * shelf_columns)]
    places = [RobotPlace(*_robot(number), home) for number, home in enumerate(homes)]
    return Site(
        name=f'{robots} robots, seed {seed}',
        rows=tuple(''.join(row) for row in _with_homes(rows, homes)),
        stations={f'packing-{number + 1}': cell for number, cell in enumerate(stations)},
        products={product.name: product for product in _products(rows, names, random)},
        robots={place.serial_number: place for place in places},
        chargers=tuple(chargers),
    )


def _rows(shelf_rows: int, shelf_columns: int) -> list[str]:
    """Two open rows above, between and below blocks of two rows of shelves."""
    gap = '..'
    open_row = '.' * (_WEST + _EAST + shelf_columns * (_SHELF + 2) - 2)

    def row(mark: str) -> str:
        return '.' * _WEST + gap.join([mark * _SHELF] * shelf_columns) + '.' * _EAST

    rows = [open_row]
    for _ in range(shelf_rows):
        rows += [row('e'), row('@'), row('@'), row('e')]
    return [*rows, open_row]


def _spread(column: int, height: int, count: int) -> list[Cell]:
    """So many cells of a column, at even distances."""
    count = min(count, height - 2)
    return [(column, round((number + 0.5) * height / count - 0.5)) for number in range(count)]


def _homes(rows: list[str], taken: set[Cell], robots: int) -> list[Cell]:
    height, width = len(rows), len(rows[0])
    wanted = [
        *((0, row) for row in range(height)),
        *((column, row) for row in (0, height - 1) for column in range(1, width - 1)),
        *((2, row) for row in range(1, height - 1)),
    ]
    homes = [cell for cell in wanted if cell not in taken][:robots]
    if len(homes) < robots:
        raise SiteError(f'{robots} robots find no place at {len(homes)} homes: more shelves')
    return homes


def _with_homes(rows: list[str], homes: list[Cell]) -> list[list[str]]:
    marks = [list(row) for row in rows]
    for column, row in homes:
        marks[row][column] = 'r'
    return marks


def _robot(number: int) -> tuple[str, str]:
    kind = 'hauler' if number % 3 == 2 else 'carrier'
    return f'{kind}-{number + 1:02d}', kind


def _products(rows: list[str], names: list[str], random: Random) -> list[Product]:
    stock = [
        (column, row)
        for row, text in enumerate(rows)
        for column, mark in enumerate(text)
        if mark == 'e'
    ]
    random.shuffle(stock)
    products = []
    for name in names:
        size, light, heavy = random.choices(_SIZES, (12, 6, 2))[0]
        count = random.choice((1, 2, 2, 3))
        cells = tuple(sorted(stock.pop() for _ in range(count)))
        products.append(Product(name, cells, round(random.uniform(light, heavy), 1), size))
    return products


def site_yaml(site: Site, map_name: str) -> tuple[str, str]:
    """The texts of the site file and of its map file, to be edited and read again."""
    cells = ''.join(site.rows)
    head = (len(site.rows), len(site.rows[0]))
    map_text = '\n'.join(
        [f'{head[0]},{head[1]}', str(cells.count('e')), str(cells.count('r')), '5000', *site.rows]
    )
    lines = [
        '# Cells are [column, row], counted from 0 at the top left.',
        f'name: {site.name}',
        f'map: {map_name}',
        f'cell_m: {site.cell_m}',
        f'step_s: {site.step_s}',
        'stations:',
        *(f'  {name}: {list(cell)}' for name, cell in site.stations.items()),
        f'chargers: {[list(cell) for cell in site.chargers]}',
        'products:',
        *(
            f'  {name}: {{cells: {[list(cell) for cell in product.cells]}, '
            f'weight_kg: {product.weight_kg}, size: {product.size}}}'
            for name, product in site.products.items()
        ),
        'robots:',
        *(
            f'  {name}: {{type: {place.robot_type}, home: {list(place.home)}}}'
            for name, place in site.robots.items()
        ),
    ]
    return '\n'.join(lines) + '\n', map_text + '\n'
