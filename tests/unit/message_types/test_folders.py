"""Types of folders of .msg files, held against what the generators of ROS 2 make of them."""

import io
import shutil
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import document, load_layout, type_names, unknown_type
from ros2_kafka_bridge.message_types.definition import read_definition
from ros2_kafka_bridge.message_types.installed import installed_source
from ros2_kafka_bridge.message_types.layout import Layout, Sequence

SOURCES = {name: file for name in type_names() if (file := installed_source(name))}
CRANE = """\
# A crane of the harbour.

std_msgs/Header header
string<=20 name "K\\t1"     # painted on its side
Hook[<=2] hooks
builtin_interfaces/Duration[] turns
"""
HOOK = 'uint8 LOADED=1\nuint8 state 1 # [1] when loaded\n'
EVERYTHING = """\
bool yes true
byte octet 255
char letter 65
float32 small -1.5e-7
float64 large 1e300
float64 whole 3
int8 i8 -128
uint8 u8 0x10
int64 i64 -9223372036854775808
uint64 u64 18446744073709551615
string plain "it's"
string quoted 'say "so"'
string spaces "  two  "
string empty ""
string beyond "Grüße, 日本"
wstring wide "wörld"
string<=5 bounded "abc"
wstring<=7 wide_bounded
string<=5[2] fixed_bounded
wstring<=5[<=2] both_bounded
string[] names ["a, b", 'c', "it's"]
bool[2] flags [true, false]
byte[] bytes [0, 255]
char[3] letters [1, 2, 3]
float32[<=3] floats [1.5, -2]
int32[] none []
uint64[2] u64s [0, 18446744073709551615]
"""


@pytest.fixture(scope='module')
def copies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('copies')
    for name, source in SOURCES.items():
        file = folder / f'{name}.msg'
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, file)
    return folder


@pytest.fixture
def harbour(tmp_path: Path) -> Path:
    write_package(tmp_path / 'harbour', 'acme_msgs', {'Crane': CRANE, 'Hook': HOOK})
    return tmp_path / 'harbour'


@pytest.mark.parametrize('name', SOURCES)
def test_a_copied_file_gives_the_layout_defaults_and_hashes_of_its_package(
    name: str, copies: Path
) -> None:
    assert load_layout(name, [copies]) == load_layout(name)


def test_a_file_with_every_kind_of_field_is_read_as_ros_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = write_package(tmp_path / 'source', 'acme_msgs', {'Everything': EVERYTHING})
    install_package(package, tmp_path / 'prefix')
    read = load_layout('acme_msgs/msg/Everything', [tmp_path / 'source'])
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    assert read == load_layout('acme_msgs/msg/Everything')
    assert read.type_hash
    assert len(read.fields) == len(EVERYTHING.splitlines())


def test_a_package_of_the_user_is_read_before_and_after_its_build_alike(
    harbour: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = load_layout('acme_msgs/msg/Crane', [harbour])
    prefix = tmp_path / 'install'
    install_package(harbour / 'acme_msgs', prefix, ['std_msgs', 'builtin_interfaces'])
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    after = load_layout('acme_msgs/msg/Crane')
    assert after == before
    assert document(after) == document(before, [harbour])
    hooks = after.fields[2].kind
    assert isinstance(hooks, Sequence)
    assert hooks.item == load_layout('acme_msgs/msg/Hook')


def test_a_default_may_be_nan_or_infinite(tmp_path: Path) -> None:
    text = 'float32 x nan\nfloat64 far -inf\nfloat64[2] both [nan, 1.5]\nfloat32[] one [inf]\n'
    write_package(tmp_path, 'acme_msgs', {'Crane': text})
    fields = load_layout('acme_msgs/msg/Crane', [tmp_path]).fields
    assert repr([field.default for field in fields]) == '[nan, -inf, (nan, 1.5), (inf,)]'


def test_files_read_at_the_same_time_leave_stderr_as_it_was(
    harbour: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parser = pytest.importorskip('rosidl_adapter.parser')
    parse = parser.parse_message_string
    first_inside, second_inside, first_through = (threading.Event() for _ in range(3))

    def parse_in_turn(*given: str) -> object:
        if not first_inside.is_set():
            first_inside.set()
            # In vain where only one is let in at a time.
            second_inside.wait(timeout=1)
        else:
            second_inside.set()
            first_through.wait(timeout=60)
        return parse(*given)

    monkeypatch.setattr(parser, 'parse_message_string', parse_in_turn)
    monkeypatch.setattr(sys, 'stderr', io.StringIO())
    before = sys.stderr
    file = harbour / 'acme_msgs/msg/Hook.msg'
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(read_definition, 'acme_msgs/msg/Hook', file)
        first.add_done_callback(lambda _: first_through.set())
        assert first_inside.wait(timeout=60)
        second = pool.submit(read_definition, 'acme_msgs/msg/Hook', file)
        assert first.result() == second.result()
    assert sys.stderr is before


def test_a_type_of_a_folder_is_named_among_the_installed_ones(harbour: Path) -> None:
    names = type_names([harbour])
    assert {'acme_msgs/msg/Crane', 'acme_msgs/msg/Hook', 'std_msgs/msg/String'} <= {*names}
    assert names == sorted(names)
    assert unknown_type('acme_msgs/msg/Crane', [harbour]) is None
    assert unknown_type('acme_msgs/msg/Crain', [harbour]) == (
        'no message type acme_msgs/msg/Crain here (did you mean acme_msgs/msg/Crane?)'
    )
    assert 'acme_msgs/msg/Crane' not in type_names()


@pytest.mark.parametrize(
    'where', ['acme_msgs', 'src/acme_msgs', 'src/harbour/messages/acme_msgs', '../outer/acme_msgs']
)
def test_packages_are_found_at_any_depth_of_a_workspace(where: str, tmp_path: Path) -> None:
    workspace = tmp_path / 'workspace'
    (workspace / 'src').mkdir(parents=True)
    package = (workspace / where).resolve()
    write_package(package.parent, 'acme_msgs', {'Hook': HOOK})
    if package.parent.name == 'outer':
        (workspace / 'src/linked').symlink_to(package)
        (package / 'package.xml').write_text('<package><name>acme_msgs</name></package>')
    assert load_layout('acme_msgs/msg/Hook', [workspace]).fields[0].name == 'state'


def test_a_folder_may_be_a_package_itself(harbour: Path) -> None:
    package = harbour / 'acme_msgs'
    assert load_layout('acme_msgs/msg/Hook', [package]).type_name == 'acme_msgs/msg/Hook'
    assert load_layout('acme_msgs/msg/Hook', [package / 'msg']).fields


def test_the_name_of_a_package_is_the_one_in_its_manifest(harbour: Path) -> None:
    package = (harbour / 'acme_msgs').rename(harbour / 'checked-out')
    (package / 'package.xml').write_text('<package><name> acme_msgs </name></package>')
    assert unknown_type('acme_msgs/msg/Crane', [harbour]) is None
    (package / 'package.xml').write_text('<package><name>')
    assert 'package.xml: no element found' in (unknown_type('acme_msgs/msg/Hook', [harbour]) or '')


def test_a_manifest_that_names_no_package_is_said_and_one_with_a_dash_hides_no_other(
    harbour: Path,
) -> None:
    manifest = write_package(harbour, 'other', {'Hook': HOOK}) / 'package.xml'
    for odd in ('<?xml version="1.0" encoding="bogus"?><package/>', '<p><name>a/b</name></p>'):
        manifest.write_text(odd)
        assert f'{manifest}: ' in (unknown_type('acme_msgs/msg/Hook', [harbour]) or '')
    manifest.write_text('<package><name>not-of-ros</name></package>')
    assert unknown_type('acme_msgs/msg/Hook', [harbour]) is None


def test_what_a_build_of_the_workspace_left_is_passed_by(harbour: Path) -> None:
    left = write_package(harbour / 'install/acme_msgs/share', 'acme_msgs', {'Hook': 'int8 old\n'})
    write_package(harbour / '.git', 'acme_msgs', {'Hook': 'int8 old\n'})
    (harbour / 'install/COLCON_IGNORE').touch()
    assert load_layout('acme_msgs/msg/Hook', [harbour]).fields[0].name == 'state'
    assert load_layout('acme_msgs/msg/Hook', [left]).fields[0].name == 'old'


def test_the_first_folder_hides_later_ones_and_what_is_installed(
    harbour: Path, tmp_path: Path
) -> None:
    other = tmp_path / 'other'
    write_package(other, 'acme_msgs', {'Hook': 'int8 old\n'})
    write_package(other, 'builtin_interfaces', {'Duration': 'int64 nanoseconds\n'})
    assert load_layout('acme_msgs/msg/Hook', [harbour, other]).fields[0].name == 'state'
    assert load_layout('acme_msgs/msg/Hook', [other, harbour]).fields[0].name == 'old'
    turns = load_layout('acme_msgs/msg/Crane', [harbour, other]).fields[3].kind
    assert isinstance(turns, Sequence)
    assert isinstance(turns.item, Layout)
    assert [field.name for field in turns.item.fields] == ['nanoseconds']


def test_an_installed_type_takes_what_a_folder_hides_into_itself_and_its_hash(
    tmp_path: Path,
) -> None:
    write_package(tmp_path, 'builtin_interfaces', {'Time': 'int64 nanoseconds\n'})
    header = load_layout('std_msgs/msg/Header', [tmp_path])
    assert isinstance(header.fields[0].kind, Layout)
    assert header.fields[0].kind.fields[0].name == 'nanoseconds'
    assert header.type_hash != load_layout('std_msgs/msg/Header').type_hash


def test_an_empty_file_is_a_message_without_fields(tmp_path: Path) -> None:
    write_package(tmp_path, 'acme_msgs', {'Nothing': '', 'Comment': '# Nothing, too.'})
    assert load_layout('acme_msgs/msg/Nothing', [tmp_path]).fields == ()
    assert load_layout('acme_msgs/msg/Comment', [tmp_path]).fields == ()


def test_a_folder_without_messages_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'there is no PACKAGE/msg/\*\.msg in it'):
        type_names([tmp_path])
    with pytest.raises(ConfigError, match=r'/nowhere: there is no such folder'):
        load_layout('std_msgs/msg/String', [tmp_path / 'nowhere'])
    assert 'no such folder' in (unknown_type('std_msgs/msg/String', [tmp_path / 'nowhere']) or '')


def test_a_type_that_is_twice_in_a_folder_is_told_with_both_files(harbour: Path) -> None:
    write_package(harbour / 'old', 'acme_msgs', {'Hook': HOOK})
    with pytest.raises(ConfigError, match=r'Hook is both .*/acme_msgs/.* and .*/old/acme_msgs/'):
        type_names([harbour])


def test_types_that_hold_each_other_are_told(tmp_path: Path) -> None:
    write_package(tmp_path, 'acme_msgs', {'A': 'B b\n', 'B': 'C[] c\n', 'C': 'B[2] b\n'})
    with pytest.raises(ConfigError) as caught:
        load_layout('acme_msgs/msg/A', [tmp_path])
    assert caught.value.problems == [
        'acme_msgs/msg/B holds itself: acme_msgs/msg/B > acme_msgs/msg/C > acme_msgs/msg/B'
    ]


@pytest.mark.parametrize(
    ('text', 'place', 'problem'),
    [
        ('int32 a\n\nHok b # held\n', 3, 'no message type acme_msgs/msg/Hok here (did you mean'),
        ('other_msgs/Hok b\n', 1, 'no message type other_msgs/msg/Hok here'),
        ('# One.\nint32 Bad\n', 2, "'int32 Bad': 'Bad' is an invalid field name"),
        ('int32 a\nint32\n', 2, "'int32': expected TYPE NAME, TYPE NAME DEFAULT or"),
        ('int32 a\n  int32 b\n', 2, "'  int32 b': the type of a field stands at the beginning"),
        ('int32 a\nint8 b 300\n', 2, "value '300' can not be converted to type 'int8'"),
        ('int32 a\nint8[2] b [1]\n', 2, 'array must have exactly 2 elements, not 1'),
        ('int32 a\nint32 b\nint8 a\n', 3, 'duplicate names: a'),
        ('int32 lower=1\n', 1, "'lower' is an invalid constant name"),
        ('a/b/c x\n', 1, "'a/b/c x': expected TYPE NAME"),
        ('string<=0 x\n', 1, 'must be a valid integer value > 0'),
        ('int32[0] x\n', 1, 'size of array type'),
        ('int32 x\nHook hook {}\n', 2, 'parsing string values into type'),
        ('int32 x\ntime stamp\n', 2, 'time is of ROS 1, use builtin_interfaces/Time'),
    ],
)
def test_a_mistake_in_a_file_is_told_with_its_line(
    text: str, place: int, problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package = write_package(tmp_path, 'acme_msgs', {'Crane': text, 'Hook': HOOK})
    with pytest.raises(ConfigError) as caught:
        load_layout('acme_msgs/msg/Crane', [tmp_path])
    (said,) = caught.value.problems
    assert said.startswith(f'{package}/msg/Crane.msg:{place}: ')
    assert problem in said
    assert capsys.readouterr() == ('', '')


def test_a_file_that_is_not_utf8_is_told_with_its_line(tmp_path: Path) -> None:
    package = write_package(tmp_path, 'acme_msgs', {'Hook': HOOK})
    (package / 'msg/Hook.msg').write_bytes(b'int32 a\nint32 b # gr\xfcn\n')
    with pytest.raises(ConfigError, match=r'/Hook\.msg:2: not UTF-8: 0xfc$'):
        load_layout('acme_msgs/msg/Hook', [tmp_path])


@pytest.mark.parametrize(
    ('package', 'short_name', 'problem'),
    [
        ('acme_msgs', 'crane', "'crane' is an invalid message name"),
        ('Acme', 'Crane', "'Acme' is an invalid package name"),
    ],
)
def test_a_name_that_ros_refuses_is_told(
    package: str, short_name: str, problem: str, tmp_path: Path
) -> None:
    write_package(tmp_path, package, {short_name: 'int32 a\n'})
    with pytest.raises(ConfigError, match=rf'{short_name}\.msg: {problem}'):
        load_layout(f'{package}/msg/{short_name}', [tmp_path])


def test_without_the_parser_of_ros_the_sentence_says_so(
    harbour: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'rosidl_adapter', None)
    with pytest.raises(ConfigError, match=r'source your ROS 2 .*or install its wheels'):
        load_layout('acme_msgs/msg/Hook', [harbour])
