"""The house: few modules at its front, rooms that say what lives in them, imports one way."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from support.processes.terminal import finished

from ros2_kafka_bridge.config.direction import Direction

ROOT = Path(__file__).parents[2]
HOUSE = ROOT / 'src' / 'ros2_kafka_bridge'
FRONT = sorted(path.stem for path in HOUSE.glob('*.py') if path.stem != '__init__')
ROOMS = sorted(path.parent for path in HOUSE.glob('*/__init__.py'))
WITHIN = sorted(path.parent for path in HOUSE.glob('*/*/__init__.py'))


def test_at_most_ten_modules_stand_at_the_front() -> None:
    assert len(FRONT) <= 10, f'which room is home to one of {", ".join(FRONT)}?'


def test_no_file_has_more_than_four_hundred_lines() -> None:
    places = ('src', 'tests', 'benchmarks', 'rig', 'examples', 'tools')
    files = [file for place in places for file in (ROOT / place).rglob('*.py')]
    counts = {str(file.relative_to(ROOT)): file.read_bytes().count(b'\n') for file in files}
    assert {file: count for file, count in counts.items() if count > 400} == {}


@pytest.mark.parametrize('room', [*ROOMS, *WITHIN], ids=lambda room: str(room.relative_to(HOUSE)))
def test_a_room_says_what_lives_there(room: Path) -> None:
    face = ast.parse((room / '__init__.py').read_text())
    said = ast.get_docstring(face)
    assert said
    assert room in WITHIN or '\n\n' in said, 'and what may not, or what it leaves to others?'


def test_contributing_shows_the_rooms_in_the_order_in_which_they_stand() -> None:
    picture = (ROOT / 'CONTRIBUTING.md').read_text().split('```')[1]
    places = [set(re.findall(r'[a-z_]+', line[:35])) for line in picture.strip().splitlines()]
    shown = [{name.removesuffix('_py') for name in place} - {'py'} for place in places]
    settings = tomllib.loads((ROOT / 'pyproject.toml').read_text())
    layers = settings['tool']['importlinter']['contracts'][0]['layers']
    order = {name: n for n, layer in enumerate(layers) for name in layer.split(' | ')}
    assert set(order) == set().union(*shown)
    for above, below in pairwise(shown):
        assert max(order[x] for x in above) <= min(order[x] for x in below), (above, below)


def test_imports_go_down_from_room_to_room_and_never_in_a_circle() -> None:
    linter = Path(sys.executable).with_name('lint-imports')  # in here it would silence the log
    command = [str(linter), '--no-cache', '--no-logo']
    run = finished(command, cwd=ROOT)
    assert run.returncode == 0, run.stdout


def taken_from_the_face(file: Path) -> set[str]:
    """What a module takes from the package itself; `*` for all of it."""
    taken = set()
    for node in ast.walk(ast.parse(file.read_text())):
        match node:
            case ast.ImportFrom(module='ros2_kafka_bridge', names=names):
                taken |= {name.name for name in names}
            case ast.Import(names=names) if any(x.name == 'ros2_kafka_bridge' for x in names):
                taken.add('*')
    return taken


def test_rooms_take_nothing_but_the_version_from_the_face() -> None:
    """The linter lets the face import all rooms: what is taken there could come from above."""
    submodules = {*FRONT, *(room.name for room in ROOMS)}
    for file in HOUSE.rglob('*.py'):
        assert taken_from_the_face(file) <= {'__version__', *submodules}, file


def types_of(file: Path) -> Iterator[tuple[str, str]]:
    """The public names of types in a file, each with what it is."""
    for node in ast.parse(file.read_text()).body:
        match node:
            case ast.ClassDef(name=name):
                yield name, f'class in {file.relative_to(HOUSE)}'
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if not name.isupper():
                yield name, ast.unparse(value)


def test_no_two_public_types_share_a_name() -> None:
    """One name, one thing, in all rooms: what is private to its module may have any name."""
    meanings: dict[str, set[str]] = {}
    for file in sorted(HOUSE.rglob('*.py')):
        for name, meaning in types_of(file):
            if name[0].isupper():
                meanings.setdefault(name, set()).add(meaning)
    assert not {name: said for name, said in meanings.items() if len(said) > 1}


WAY = re.compile(
    r'\b(KafkaToRos(Route)?|RosToKafka(Route)?|[dD]irections?|to_ros|to_kafka|'
    r"'kafka_to_ros'|'ros_to_kafka')(?!\()\b"
)
OPTION = re.compile(r'\b(options|form|order)\.to_ros\b')  # where letters are replayed to


def asks_which_way(node: ast.AST) -> bool:
    """Whether a piece of code goes one way or the other by the class or direction of a route."""
    match node:
        case ast.Call(func=ast.Name(id='isinstance' | 'issubclass' | 'hasattr' | 'type')):
            asked = ast.unparse(node)
        case ast.Compare():
            asked = ast.unparse(node)
        case ast.Match(subject=subject, cases=cases):
            asked = ' '.join(map(ast.unparse, [subject, *(case.pattern for case in cases)]))
        case _:
            return False
    return bool(WAY.search(OPTION.sub('', asked)))


def test_few_places_ask_a_route_which_way_it_goes() -> None:
    """What differs is data: another kind of route is a row in a table, and found there."""
    asks = [
        f'{file.relative_to(HOUSE)}:{node.lineno}'
        for file in HOUSE.rglob('*.py')
        if file.parent.name != 'config'
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.expr | ast.stmt) and asks_which_way(node)
    ]
    page = [
        f'{file.relative_to(HOUSE)}: {found}'
        for file in HOUSE.rglob('*.js')
        for found in re.findall(r'\bdirection\b', file.read_text())
    ]
    assert len(asks + page) <= 10, asks + page
    assert any('wiring.py' in place for place in asks), 'the one that has to'


def test_a_table_by_direction_has_a_row_for_each() -> None:
    tables = [
        (file, node)
        for file in HOUSE.rglob('*.py')
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Dict)
        if any(key is not None and 'Direction.' in ast.unparse(key) for key in node.keys)
    ]
    assert len(tables) > 5
    for file, table in tables:
        assert len(table.keys) == len(Direction), f'{file}:{table.lineno}'


def test_the_topics_type_and_key_of_a_route_are_read_in_one_way() -> None:
    """No end of a route is reached into for what all routes have, wherever it stands."""
    reached = re.compile(r'\b(source|sink)\.(kafka|ros|type|qos|key|dead_letter)\b')
    for file in HOUSE.rglob('*.py'):
        if file.parent.name != 'config':
            assert not reached.search(file.read_text()), file


STATE = {'stage', 'lane', 'next', 'previous', 'row', 'size_bytes'}
CHANGES = {'append', 'appendleft', 'clear', 'extend', 'extendleft', 'pop', 'popleft', 'remove'}


def changes_an_entry(node: ast.AST) -> bool:
    """Whether a piece of code writes the state of what is in flight, or changes a lane."""
    match node:
        case ast.Attribute(value=ast.Name(id='self')):
            return False
        case ast.Attribute(attr=attr, ctx=ast.Store()):
            return attr in STATE
        case ast.Call(func=ast.Attribute(value=ast.Attribute(attr='ready'), attr=attr)):
            return attr in CHANGES
    return False


def test_one_room_writes_the_state_of_what_is_in_flight() -> None:
    written = [
        file.relative_to(HOUSE)
        for file in HOUSE.rglob('*.py')
        for node in ast.walk(ast.parse(file.read_text()))
        if changes_an_entry(node)
    ]
    assert {str(file.parent) for file in written} == {'route/flight'}, written
    assert len(written) > 20, 'it is found'


def methods() -> set[str]:
    """Every method of the house, as `Class.method`."""
    found = set()
    for file in HOUSE.rglob('*.py'):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ClassDef):
                found |= {
                    f'{node.name}.{x.name}' for x in node.body if isinstance(x, ast.FunctionDef)
                }
    return found


def test_the_path_of_a_message_leads_through_functions_that_are_there() -> None:
    named = re.findall(r'`([A-Z]\w+\.\w+)`', (ROOT / 'CONTRIBUTING.md').read_text())
    assert len(named) > 15
    assert not set(named) - methods()
