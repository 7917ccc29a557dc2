"""The house: few modules at its front, rooms that say what lives in them, imports one way."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

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
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
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
