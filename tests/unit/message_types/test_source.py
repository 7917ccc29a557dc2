"""Which description of a type counts: a folder's, a package's, a node's."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.message_types import INSTALLED, describe
from ros2_kafka_bridge.message_types import source as source_module
from ros2_kafka_bridge.message_types.description import DescribedTypes, type_hash
from ros2_kafka_bridge.message_types.source import Ask, TypeSource

CRANE = 'acme_msgs/msg/Crane'
NODE = 'is described by the node /robot'


def defined(folder: Path, field: str) -> Path:
    """A folder of packages that defines a crane by one field."""
    write_package(folder, 'acme_msgs', {'Crane': f'{field}\n'})
    return folder


def hash_of(folder: Path) -> str:
    """The hash of the crane of a folder."""
    return type_hash(CRANE, describe(CRANE, [folder]).types)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that is installed, and its .msg files."""
    folder = defined(tmp_path / 'installed/src', 'float64 installed')
    install_package(folder / 'acme_msgs', tmp_path / 'installed')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'installed'))
    return folder


def telling(folder: Path, asked: list[str]) -> Ask:
    """A node that has the types of a folder."""

    def ask(name: str, wanted: str) -> DescribedTypes:
        asked.append(wanted)
        types = describe(name, [folder]).types
        if type_hash(name, types) != wanted:
            raise RouteError('nobody describes it: /robot describes another one')
        return DescribedTypes(types, {}, NODE)

    return ask


def nobody(_name: str, _wanted: str) -> DescribedTypes:
    """A graph in which no node answers."""
    raise RouteError('nobody describes it')


def field_of(described: DescribedTypes) -> str:
    """The only field of a crane."""
    return described.types[CRANE].fields[0].name


def test_a_folder_comes_before_what_is_installed_and_both_before_a_node(
    tmp_path: Path, installed: Path
) -> None:
    folder = defined(tmp_path / 'folder', 'float64 of_folder')
    found = TypeSource([folder]).describe(CRANE)
    assert field_of(found) == 'of_folder'
    assert found.origin == f'is described by {folder}/acme_msgs/msg/Crane.msg'
    found = TypeSource().describe(CRANE, {hash_of(installed): '/robot'}, nobody)
    assert (field_of(found), found.origin) == ('installed', INSTALLED)


def test_the_first_counts_that_is_defined_as_the_graph_shows(
    tmp_path: Path, installed: Path
) -> None:
    folder = defined(tmp_path / 'folder', 'float64 of_folder')
    robots = defined(tmp_path / 'robots', 'float64 of_robots')
    source, asked = TypeSource([folder]), list[str]()
    for where in (folder, installed, robots):
        shown = {hash_of(where): '/robot'}
        found = source.describe(CRANE, shown, telling(robots, asked))
        assert type_hash(CRANE, found.types) in shown
    assert asked == [hash_of(robots)]
    assert found.origin == NODE


def test_what_nobody_describes_is_what_is_known_here(tmp_path: Path, installed: Path) -> None:
    """Its messages are refused one by one, and `cdr` carries them."""
    robots = hash_of(defined(tmp_path / 'robots', 'float64 of_robots'))
    found = TypeSource().describe(CRANE, {robots: '/robot'}, nobody)
    assert field_of(found) == 'installed'
    both = {robots: '/robot', hash_of(installed): '/other'}
    assert field_of(TypeSource().describe(CRANE, both, nobody)) == 'installed'


def test_a_node_is_asked_once_and_again_after_it_has_failed(tmp_path: Path) -> None:
    robots = defined(tmp_path / 'robots', 'float64 of_robots')
    shown, source, asked = {hash_of(robots): '/robot'}, TypeSource(), list[str]()
    with pytest.raises(RouteError, match='no message type acme_msgs/msg/Crane here, and nobody d'):
        source.describe(CRANE, shown, nobody)
    for _ in range(3):
        assert source.describe(CRANE, shown, telling(robots, asked)).origin == NODE
    assert asked == [hash_of(robots)]


def test_two_definitions_of_which_none_is_known_are_told_with_who_uses_them(
    tmp_path: Path,
) -> None:
    old, new = (hash_of(defined(tmp_path / it, f'float64 {it}')) for it in ('old', 'new'))
    with pytest.raises(RouteError) as raised:
        TypeSource().describe(CRANE, {old: '/one, /two', new: '/three'}, nobody)
    said = str(raised.value)
    assert 'nodes define it in 2 ways' in said
    assert f'{old} by /one, /two' in said
    assert f'{new} by /three' in said


@pytest.mark.parametrize(
    'spoil',
    [lambda file: file.write_text('float64\n'), lambda file: file.write_bytes(b'\xff')],
)
def test_a_file_that_cannot_be_read_is_told_unless_a_node_tells_better(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    robots = defined(tmp_path / 'robots', 'float64 of_robots')
    shown = {hash_of(robots): '/robot'}
    folder = defined(tmp_path / 'folder', 'float64 of_folder')
    spoil(folder / 'acme_msgs/msg/Crane.msg')
    source = TypeSource([folder])
    with pytest.raises(ConfigError, match=r'Crane\.msg:1: '):
        source.describe(CRANE)
    with pytest.raises(RouteError, match=r'Crane\.msg:1: .*, and nobody describes it'):
        source.describe(CRANE, shown, nobody)
    assert source.describe(CRANE, shown, telling(robots, [])).origin == NODE


def test_guarantee_6b_nodes_that_describe_ever_new_types_fill_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(source_module, '_MOST_FIELDS', 3)
    source = TypeSource()
    for number in range(5):
        robots = defined(tmp_path / f'{number}', f'float64 f{number}')
        shown = {hash_of(robots): '/robot'}
        if number < 3:
            source.describe(CRANE, shown, telling(robots, []))
            continue
        with pytest.raises(RouteError, match='described types of 3 fields to this process'):
            source.describe(CRANE, shown, telling(robots, []))


def test_two_versions_that_are_known_here_are_settled_by_the_graph(
    tmp_path: Path, installed: Path
) -> None:
    """Who names a folder that is older than what is installed goes on with what is used."""
    folder = defined(tmp_path / 'folder', 'float64 of_folder')
    source = TypeSource([folder])
    assert f'{folder}/acme_msgs/msg/Crane.msg otherwise than it' in (source.unsettled(CRANE) or '')
    assert field_of(source.describe(CRANE, {hash_of(installed): '/robot'})) == 'installed'
    same = defined(tmp_path / 'same', 'float64 installed')
    assert TypeSource([same]).unsettled(CRANE) is None
    assert TypeSource().unsettled(CRANE) is None


def test_settings_that_import_packages_leave_folders_out(tmp_path: Path) -> None:
    folder = defined(tmp_path / 'folder', 'float64 of_folder')
    assert TypeSource.of(RosSettings(message_path=[folder])).unknown(CRANE) is None
    imports = RosSettings(packages='import', message_path=[folder])
    assert TypeSource.of(imports).unknown(CRANE)


def test_a_type_that_nobody_knows_is_told_with_what_is_near() -> None:
    with pytest.raises(ConfigError, match=r'did you mean std_msgs/msg/String\?'):
        TypeSource().describe('std_msg/msg/String')
    with pytest.raises(RouteError, match=r'String\?\), and nobody there tells how it is defined'):
        TypeSource().describe('std_msg/msg/String', {}, nobody)
