"""What may be imported is what docs/python.md lists, and nobody is shown anything else."""

import ast
import inspect
import re
import subprocess
import sys
import typing
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from importlib import import_module
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from types import FunctionType
from typing import Any, Final, NamedTuple

import pytest
from support.install.checkout import ROOT, fenced, pages

import ros2_kafka_bridge
from ros2_kafka_bridge import Bridge, Snapshot
from ros2_kafka_bridge.config import values

PAGE: Final = 'docs/python.md'
PUBLIC: Final = (
    'ros2_kafka_bridge',
    'ros2_kafka_bridge.depth',
    'ros2_kafka_bridge.testing.local_kafka',
    'ros2_kafka_bridge.testing.embedded_broker',
    'ros2_kafka_bridge.testing.memory',
    'ros2_kafka_bridge.testing.orders',
)
EXAMPLES: Final = sorted((ROOT / 'examples').rglob('*.py'))

# For the processes of the command, and for what watches them.
NOT_OF_A_BRIDGE: Final = {'begin', 'end'}
NOT_OF_A_SNAPSHOT: Final = {'made_s', 'beat_s', 'measures', 'at_rest'}
# A Config is promised by its name, and those of its routes.
NOT_PROMISED: Final = {
    'About',  # of a RouteError
    'HasHeaders',  # whatever has headers() is one
    'Measures',  # of a Snapshot
    *('Begun', 'Loaded', 'RouteFailed', 'RoutesEnded'),  # run() is promised without arguments
}


# The page and the modules


def listed() -> dict[str, list[str]]:
    """The names in the tables of the page, by module."""
    told = (ROOT / PAGE).read_text().split('\n## The names\n')[1]
    parts = re.split(r'^### `([\w.]+)`$', told, flags=re.MULTILINE)[1:]
    return {
        module: [
            name
            for row in re.findall(r'^\| (`.*?) \|', text, re.MULTILINE)
            for name in re.findall(r'`(\w+)`', row)
        ]
        for module, text in zip(parts[::2], parts[1::2], strict=True)
    }


def test_the_page_lists_the_public_modules() -> None:
    assert tuple(listed()) == PUBLIC


@pytest.mark.parametrize('module', PUBLIC)
def test_the_page_and_a_module_name_the_same(module: str) -> None:
    assert sorted(listed()[module]) == sorted(import_module(module).__all__)


@pytest.mark.parametrize('module', PUBLIC)
def test_each_public_name_can_be_imported_and_says_what_it_is(module: str) -> None:
    silent = [name for name in import_module(module).__all__ if not said_of(module, name)]
    assert silent in ([], ['__version__'])


def said_of(module: str, name: str) -> str:
    """The docstring of a name, or what stands below it where it is a constant."""
    value = getattr(import_module(module), name)
    if isinstance(value, type | FunctionType):
        return (value.__doc__ or '') if value.__module__.startswith('ros2_kafka_bridge') else ''
    tree = ast.parse(Path(str(import_module(module).__file__)).read_text())
    for node, below in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(node, ast.ImportFrom) and name in {one.name for one in node.names}:
            return said_of(str(node.module), name)
        if isinstance(node, ast.Assign | ast.AnnAssign) and name in names_set(node):
            told = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
            return str(below.value.value) if told else ''  # type: ignore[union-attr]
    return ''


def names_set(node: ast.Assign | ast.AnnAssign) -> set[str]:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def test_the_page_tells_what_a_bridge_can_do() -> None:
    table = (ROOT / PAGE).read_text().split('| of a `Bridge` | |')[1].split('\n\n')[0]
    cells = ''.join(re.findall(r'^\|(.*?)\|', table, re.MULTILINE))
    told = set(re.findall(r'`(\w+)(?=[(.`])', cells))
    there = {name for name in [*vars(Bridge), 'config', 'stop'] if not name.startswith('_')}
    assert told - {'Bridge'} == there - NOT_OF_A_BRIDGE
    [arguments] = re.findall(r'`Bridge\((.*?)\)`', table)
    assert arguments.split(', ') == [*inspect.signature(Bridge).parameters][:2]


def test_the_page_tells_what_a_snapshot_has() -> None:
    text = (ROOT / PAGE).read_text()
    told = text.split('\nA `Snapshot` has')[1].split('\n\n')[0]
    there = {name for name in vars(Snapshot) if not name.startswith('_')}
    assert set(re.findall(r'`([a-z_]+)`', told)) == there - NOT_OF_A_SNAPSHOT


def test_the_page_tells_the_states() -> None:
    [row] = [line for line in (ROOT / PAGE).read_text().splitlines() if '| `State` |' in line]
    assert re.findall(r'`([a-z]+)`', row) == [*ros2_kafka_bridge.State]


@pytest.mark.parametrize('name', ['load', 'loads'])
def test_the_page_tells_the_arguments_of_what_reads_a_file(name: str) -> None:
    told = re.search(r'their arguments `(\w+)` \(`(\w+)`, `(\w+)`\) and `(\w+)`', read(PAGE))
    assert told is not None
    path, text, file_name, environ = told.groups()
    promised = [path, environ] if name == 'load' else [text, file_name, environ]
    parameters = inspect.signature(getattr(ros2_kafka_bridge, name)).parameters.values()
    assert [one.name for one in parameters][: len(promised)] == promised
    assert all(one.default is None for one in [*parameters][len(promised) :])


# What public names take and give


def test_what_public_names_take_and_give_is_public_too() -> None:
    public = {name for module in PUBLIC for name in import_module(module).__all__}
    needed = {
        kind.__name__
        for module in PUBLIC
        for name in import_module(module).__all__
        if name != 'Config'
        for kind in kinds_of(getattr(import_module(module), name))
    }
    assert needed - public == NOT_PROMISED


def kinds_of(value: Any) -> set[type]:
    """The classes of the package in the annotations of a class or function."""
    if not isinstance(value, type | FunctionType):
        return set()
    members = [*vars(value).items()] if isinstance(value, type) else []
    calls = [getattr(member, 'fget', member) for name, member in members if is_shown(name)]
    known = {**vars(values), 'Mapping': Mapping}
    hints = [
        hint
        for one in (value, *calls)
        if isinstance(one, type | FunctionType)
        for name, hint in typing.get_type_hints(one, localns=known).items()
        if is_shown(name)
    ]
    bases = value.__mro__[1:] if isinstance(value, type) else ()
    return {kind for hint in [*hints, *bases] for kind in within(hint)}


def is_shown(name: str) -> bool:
    return name == '__init__' or not name.startswith('_')


def within(hint: Any) -> Iterator[type]:
    bound = getattr(hint, '__bound__', None)
    for one in (*typing.get_args(hint), *([bound] if bound is not None else [])):
        for part in one if isinstance(one, list) else [one]:
            yield from within(part)
    kind = typing.get_origin(hint) or hint
    if isinstance(kind, type) and kind.__module__.startswith('ros2_kafka_bridge'):
        yield kind


# What users are shown


class Shown(NamedTuple):
    """An import that a page or an example shows; no name stands for the module as a whole."""

    file: str
    module: str
    name: str

    @property
    def is_public(self) -> bool:
        """Whether it may be imported."""
        whole = f'{self.module}.{self.name}' if self.name else self.module
        return whole in PUBLIC or (
            self.module in PUBLIC and self.name in import_module(self.module).__all__
        )


def test_pages_and_examples_show_public_names_alone() -> None:
    found = [one for file in (*pages(), *EXAMPLES) for one in shown_in(file)]
    assert {one.name for one in found} >= {'Deduplicator', 'ServiceTimes', 'Bridge', 'orders'}
    assert [one for one in found if not one.is_public] == []


def shown_in(file: Path) -> Iterator[Shown]:
    """What an example imports of the package, or the code of a page, fenced or indented."""
    text = file.read_text()
    if file.suffix == '.md':
        names = r'(?:\([^)]*\)|[^\n(]+)'
        text = '\n'.join(
            re.findall(rf'(?m)^[ >]*((?:from ros2_kafka_bridge[\w.]* )?import {names})', text)
        )
    for node in ast.walk(ast.parse(text)):
        modules = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        yield from (Shown(file.name, one, '') for one in modules if is_ours(one))
        if isinstance(node, ast.ImportFrom) and is_ours(node.module or ''):
            yield from (Shown(file.name, str(node.module), one.name) for one in node.names)


def is_ours(module: str) -> bool:
    return module.partition('.')[0] == 'ros2_kafka_bridge'


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'ros2_kafka_bridge' has no attribute 'Bridges'"):
        _ = ros2_kafka_bridge.Bridges


# The programs of the page


def read(page: str) -> str:
    return (ROOT / page).read_text()


def run(program: str) -> str:
    """Run a program of the page here; returns what it has printed."""
    printed = StringIO()
    with redirect_stdout(printed):
        exec(compile(program, PAGE, 'exec'), {'__name__': '__main__'})  # noqa: S102 (our own page)
    return printed.getvalue()


def test_the_program_that_reads_a_file_prints_its_routes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('bridge.yaml').write_text(read('examples/bridge.yaml'))
    assert run(fenced(PAGE, 'python')[0]).split(' ', 1)[1].startswith("['")


def test_the_program_that_reads_a_file_prints_all_its_mistakes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    right = read('examples/bridge.yaml')
    wrong = right.replace('name:', 'nmae:', 1).replace('bootstrap.servers', 'bootstrap', 1)
    Path('bridge.yaml').write_text(wrong)
    with pytest.raises(SystemExit) as ended:
        exec(fenced(PAGE, 'python')[0], {})  # noqa: S102 (our own page)
    assert ended.value.code == 2
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2
    assert all(re.match(r'bridge\.yaml:\d+: [\w.\[\]]+: ', line) for line in lines)


@pytest.mark.parametrize('number', [2, 3])
def test_the_other_programs_of_the_page_print_what_it_says(number: int) -> None:
    program = fenced(PAGE, 'python')[number]
    said = re.findall(r'^print\(.*\)  # (.*)$', program, re.MULTILINE)
    assert said
    assert run(program).splitlines() == said


# What an import costs


def test_the_package_alone_loads_nothing_heavy() -> None:
    program = (
        'import sys, ros2_kafka_bridge;'
        'assert not {"rclpy", "confluent_kafka", "pydantic", "rich"} & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)


def test_the_package_says_that_it_is_typed() -> None:
    spec = find_spec('ros2_kafka_bridge')
    assert spec is not None
    assert spec.submodule_search_locations is not None
    assert Path(*spec.submodule_search_locations, 'py.typed').is_file()
