"""A site is read from a file or made by rules, and no place of it can be cut off by one robot."""

import re
from pathlib import Path
from random import Random

import msgspec
import pytest

from ros2_kafka_warehouse.codec import decode
from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.site import (
    Site,
    SiteError,
    check_robot_types,
    choose_site,
    make_site,
    read_site,
    site_yaml,
)
from ros2_kafka_warehouse.messages.orders import OrderRequest, OrderStatus

DOCS = Path(__file__).parents[3] / 'docs'
STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))


def free_cells(site: Site) -> set[tuple[int, int]]:
    return {
        (column, row)
        for row, text in enumerate(site.rows)
        for column, mark in enumerate(text)
        if mark != '@'
    }


def reached(free: set[tuple[int, int]], start: tuple[int, int]) -> set[tuple[int, int]]:
    seen, todo = {start}, [start]
    while todo:
        column, row = todo.pop()
        for cell in ((column + x, row + y) for x, y in STEPS):
            if cell in free and cell not in seen:
                seen.add(cell)
                todo.append(cell)
    return seen


@pytest.mark.parametrize(
    'site', [read_site(), make_site(1), make_site(4), make_site(50, 3)], ids=lambda site: site.name
)
def test_one_robot_that_stands_still_cuts_no_cell_off_from_another(site: Site) -> None:
    # So each pair of adjacent cells lies on a cycle, too, which PIBT asks for.
    free = free_cells(site)
    for cell in free:
        rest = free - {cell}
        assert reached(rest, next(iter(rest))) == rest, cell


def test_the_site_that_comes_with_the_warehouse_has_what_the_docs_promise() -> None:
    site = read_site()

    assert len(site.robots) == 12
    assert {robot.robot_type for robot in site.robots.values()} == {'carrier', 'hauler'}
    assert len(site.products) >= 60
    assert len(site.stations) == 4
    assert len(site.chargers) == 4
    for product in site.products.values():
        assert all(site.rows[row][column] == 'e' for column, row in product.cells)


@pytest.mark.parametrize('robots', [1, 7, 12, 30, 100, 150])
def test_a_site_is_made_for_any_number_of_robots(robots: int) -> None:
    site = make_site(robots)
    homes = [robot.home for robot in site.robots.values()]
    places = [*homes, *site.chargers, *site.stations.values()]

    assert len(homes) == robots
    assert len(set(places)) == len(places)
    assert set(places) <= free_cells(site)
    assert make_site(robots) == site
    assert make_site(robots, 1).products != site.products


def test_a_site_that_was_written_is_read_back_the_same(tmp_path: Path) -> None:
    site = make_site(5, 2)
    assert read_site(written(tmp_path, site)) == site


def written(directory: Path, site: Site, old: str = '', new: str = '') -> Path:
    text, rows = site_yaml(site, 'site.map')
    assert old in text
    (directory / 'site.map').write_text(rows)
    (directory / 'site.yaml').write_text(text.replace(old, new, 1))
    return directory / 'site.yaml'


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('step_s: 0.5', 'steps: 0.5', 'line 5: steps: unknown field; did you mean step_s?'),
        ('step_s: 0.5', 'step_s: fast', 'line 5: step_s: expected float, got str'),
        ('step_s: 0.5', 'step_s: 0', 'line 5: step_s: must be more than 0'),
        ('step_s: 0.5', 'step_s: .nan', 'line 5: step_s: must be a finite number, is nan'),
        ('step_s: 0.5', 'step_s: 1e300', 'line 5: step_s: must be from 0.001 to 3600 (seconds)'),
        ('cell_m: 1.0', 'cell_m: .inf', 'line 4: cell_m: must be a finite number, is inf'),
        ('packing-1: [23, 2]', 'packing-1: [4, 2]', 'line 7: stations.packing-1: 4, 2 (column'),
        ('packing-1: [23, 2]', 'packing-1: [24, 2]', 'line 7: stations.packing-1: 24, 2 (column'),
        ('packing-1: [23, 2]', 'packing-1: [2]', 'stations.packing-1: expected array of length 2'),
        ('home: [0, 1]', 'home: [0, 0]', 'robots.carrier-02.home: carrier-01 starts there, too'),
        ('type: hauler', 'typ: hauler', 'robots.hauler-03.typ: unknown field; did you mean type?'),
        ('map: site.map', 'map: no.map', 'line 3: map: there is no file'),
        ('map: site.map', 'map: [', 'line 5: not YAML'),
        ('stations:', 'stations: 3\nx:', 'line 6: stations: expected object, got int'),
    ],
)
def test_a_wrong_site_says_line_and_field_and_what_would_be_right(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    file = written(tmp_path, make_site(4), old, new)
    with pytest.raises(SiteError) as raised:
        read_site(file)
    assert str(raised.value).startswith(str(file))
    assert said in str(raised.value)


def test_a_cell_that_no_way_leads_to_is_refused(tmp_path: Path) -> None:
    site = make_site(4)
    file = written(tmp_path, site)
    rows = ['.' * 22 + '@.', '.' * 22 + '@@', *site.rows[2:]]
    marks = ''.join(rows)
    head = f'10,24\n{marks.count("e")}\n{marks.count("r")}\n1\n'
    (tmp_path / 'site.map').write_text(head + '\n'.join(rows))
    file.write_text(file.read_text().replace('home: [0, 0]', 'home: [23, 0]'))
    with pytest.raises(SiteError, match=r'carrier-01\.home: no way leads there'):
        read_site(file)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('x\n', r'site.map:1: `x` is no symbol of a map'),
        ('3,2\n0\n0\n1\n..\n..\n', r'site.map:1: announces 3 rows, but the map has 2'),
        ('2,2\n0\n0\n1\n..\n.\n', r'site.map:6: has 1 cells, but the row before it has 2'),
    ],
)
def test_a_wrong_map_says_the_line(tmp_path: Path, text: str, said: str) -> None:
    file = written(tmp_path, make_site(4))
    (tmp_path / 'site.map').write_text(text)
    with pytest.raises(SiteError, match=said):
        read_site(file)


def test_a_site_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match='cannot be read: No such file'):
        read_site(tmp_path / 'nowhere.yaml')


def test_a_type_that_no_profile_has_is_told_with_its_robot() -> None:
    site = make_site(4)
    with pytest.raises(
        SiteError, match=r"own.yaml: robots.hauler-03.type: .*'hauler'; there are c"
    ):
        check_robot_types(site, ['carrier'], Path('own.yaml'))
    check_robot_types(site, ['carrier', 'hauler'])


def test_fewer_robots_of_a_site_are_the_first_ones(tmp_path: Path) -> None:
    own = written(tmp_path, make_site(5))
    assert list(choose_site(own, 2).robots) == ['carrier-01', 'carrier-02']
    with pytest.raises(SiteError, match='has 5 robots, not 6'):
        choose_site(own, 6)
    with pytest.raises(SiteError, match='cannot be read'):
        choose_site(tmp_path / 'missing.yaml', 3)


def test_of_a_product_that_weighs_nearly_nothing_orders_are_made() -> None:
    site = make_site(2)
    products = {
        name: msgspec.structs.replace(product, weight_kg=1e-320)
        for name, product in site.products.items()
    }
    site = msgspec.structs.replace(site, products=products)
    order = random_order(site, Random(0), 'O', 0.0, read_execution_profiles())  # noqa: S311
    assert all(1 <= line.quantity <= 5 for line in order.lines)


@pytest.mark.parametrize(('page', 'count'), [('warehouse.md', 2), ('warehouse-modules.md', 1)])
def test_the_orders_of_a_page_are_taken_on_the_site_of_the_package(page: str, count: int) -> None:
    found = re.findall(r'\{"orderId": .*?\]\}', (DOCS / page).read_text('utf-8'), re.DOTALL)
    assert len(found) == count
    for text in found:
        events = OrderDesk(read_site()).receive(decode(text, OrderRequest), 0.0)
        assert [event.status for event in events] == [OrderStatus.RECEIVED]
