"""Readers of the public formats of maps, tasks and scenarios."""

from pathlib import Path

import pytest

from ros2_kafka_warehouse.domain.maps import (
    Job,
    MapError,
    Trip,
    read_map,
    read_scenario,
    read_tasks,
)

MAPD = '3,4\n3\n1\n500\n.ee.\n.@@r\n.e..\n'
MOVINGAI = 'type octile\nheight 2\nwidth 3\nmap\n.G@\nT.W\n'


def _file(place: Path, text: str, name: str = 'a.map') -> Path:
    path = place / name
    path.write_text(text, encoding='utf-8')
    return path


def test_a_mapd_map_has_endpoints_counted_row_by_row(tmp_path: Path) -> None:
    floor = read_map(_file(tmp_path, MAPD))
    assert floor.rows == ('.ee.', '.@@r', '.e..')
    assert floor.endpoints == ((1, 0), (2, 0), (1, 2))
    assert floor.starts == ((3, 1),)


def test_a_mapd_map_may_come_without_its_header_and_with_crlf(tmp_path: Path) -> None:
    bare = MAPD.split('\n', 4)[4].replace('\n', '\r\n')
    assert read_map(_file(tmp_path, bare)) == read_map(_file(tmp_path, MAPD, 'b.map'))


def test_a_movingai_map_is_known_by_its_first_line(tmp_path: Path) -> None:
    floor = read_map(_file(tmp_path, MOVINGAI))
    assert floor.rows == ('..@', '@.@')
    assert floor.endpoints == ((0, 0), (1, 0), (1, 1))
    assert floor.starts == ()


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'a.map:1: the rows of the map are missing'),
        ('3,4\n3\n', 'a.map:2: ends within its first four lines'),
        ('34\n3\n1\n5\n....\n', 'a.map:1: must be rows and columns, like `21,35`, not `34`'),
        (MAPD.replace('3,4', '3,x'), 'a.map:1: the number of columns must be a whole number'),
        (MAPD.replace('3,4', '3,5'), 'a.map:1: announces 5 columns, but the map has 4'),
        (MAPD.replace('4\n3\n', '4\n9\n'), 'a.map:2: announces 9 endpoints, but the map has 3'),
        (MAPD.replace('\n1\n', '\n-1\n'), 'a.map:3: the number of robots must not be negative'),
        (MAPD.replace('.e..', '.e.'), 'a.map:7: has 3 cells, but the row before it has 4'),
        (MAPD.replace('@@', '@#'), 'a.map:6: `#` is no symbol of a map; there are . @ e r'),
        (MOVINGAI.replace('height', 'length'), 'a.map:2: must be `height N` or `width N`'),
        (MOVINGAI.replace('height 2', 'height 3'), 'a.map:2: announces 3 x 3 cells'),
        (MOVINGAI.replace('\nmap', '\n'), 'a.map:4: must be the line `map`'),
        ('type octile\n', 'a.map:1: ends within its first four lines'),
    ],
)
def test_what_is_wrong_with_a_map_is_said_with_file_and_line(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(MapError) as raised:
        read_map(_file(tmp_path, text))
    assert str(raised.value).removeprefix(f'{tmp_path}/').startswith(said)


def test_a_map_that_is_missing_or_no_text_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(MapError, match='cannot be read: No such file'):
        read_map(tmp_path / 'none.map')
    (tmp_path / 'b.map').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(MapError, match='is no text file'):
        read_map(tmp_path / 'b.map')


@pytest.mark.parametrize('text', ['2\n0 2 0 0 0\n7\t1\t2\t0\t0\n', '0 2 0 0 0\n7 1 2 0 0\n\n'])
def test_tasks_name_endpoints_by_number_with_or_without_their_count(
    tmp_path: Path, text: str
) -> None:
    endpoints = read_map(_file(tmp_path, MAPD)).endpoints
    tasks = read_tasks(_file(tmp_path, text, 'a.task'), endpoints)
    assert tasks == (Job(0, (1, 2), (1, 0)), Job(7, (2, 0), (1, 2)))


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('3\n0 1 2 0 0\n', 'a.task:1: announces 3 tasks, but the file has 1'),
        ('0 1\n', 'a.task:1: must be release, pick-up, delivery, 0, 0'),
        ('1\n0 1 3 0 0\n', 'a.task:2: the delivery is endpoint 3, but the map has 3'),
        ('1\n0 a 3 0 0\n', 'a.task:2: the pick-up must be a whole number, not `a`'),
        ('1\n-1 1 2 0 0\n', 'a.task:2: the step of the release must not be negative'),
    ],
)
def test_what_is_wrong_with_tasks_is_said_with_file_and_line(
    tmp_path: Path, text: str, said: str
) -> None:
    endpoints = read_map(_file(tmp_path, MAPD)).endpoints
    with pytest.raises(MapError) as raised:
        read_tasks(_file(tmp_path, text, 'a.task'), endpoints)
    assert str(raised.value).removeprefix(f'{tmp_path}/').startswith(said)


def test_a_scenario_is_a_list_of_trips(tmp_path: Path) -> None:
    floor = read_map(_file(tmp_path, MOVINGAI))
    text = 'version 1\n0\ta.map\t3\t2\t0\t0\t1\t1\t2.0\n'
    assert read_scenario(_file(tmp_path, text, 'a.scen'), floor) == (Trip((0, 0), (1, 1)),)


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('0 a.map 3 2 0 0 1', 'a.scen:2: must have nine fields'),
        ('0 a.map 9 2 0 0 1 1 2', 'a.scen:2: belongs to a map of 9 x 2 cells'),
        ('0 a.map 3 2 0 0 2 0 2', 'a.scen:2: 2,0 is no free cell of the map'),
        ('0 a.map 3 2 0 0 0 7 2', 'a.scen:2: 0,7 is no free cell of the map'),
    ],
)
def test_what_is_wrong_with_a_scenario_is_said_with_file_and_line(
    tmp_path: Path, line: str, said: str
) -> None:
    floor = read_map(_file(tmp_path, MOVINGAI))
    with pytest.raises(MapError) as raised:
        read_scenario(_file(tmp_path, f'version 1\n{line}\n', 'a.scen'), floor)
    assert str(raised.value).removeprefix(f'{tmp_path}/').startswith(said)
