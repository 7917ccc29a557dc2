""".msg text that is made of a type, held against what is read of it again."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import document, load_layout, type_names
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Layout,
    Primitive,
    String,
)
from ros2_kafka_bridge.message_types.layout import Sequence as Listed
from ros2_kafka_bridge.message_types.writing import msg_files, msg_text

CRANE = """\
# A crane.
#   It lifts [t].

# how it is
uint8 BUSY=1
string NAME="a # \\"b\\""

string<=20[<=3] names ["it's", 'say "so"', "a, b"]
# the hooks,
# # all of them
Hook[2] hooks
wstring<=7 wide
byte octet 255
float32[] floats [1.5, -1e-07, nan, inf]
"""


def _written(layout: Layout, folder: Path) -> Path:
    for name, text in msg_files(layout).items():
        file = folder / f'{name}.msg'
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8')
    return folder


def _of(*fields: Field) -> Layout:
    return Layout('acme_msgs/msg/Odd', fields)


def _back(layout: Layout, folder: Path) -> Layout:
    return load_layout(layout.type_name, [_written(layout, folder)])


def test_every_installed_type_is_read_again_as_it_was_with_its_docs(tmp_path: Path) -> None:
    layouts = dict(_layouts())
    assert len(layouts) > 100
    for layout in layouts.values():
        _written(layout, tmp_path)
    for name, layout in layouts.items():
        assert document(load_layout(name, [tmp_path]), [tmp_path]) == layout


def _layouts() -> Iterator[tuple[str, Layout]]:
    for name in type_names():
        layout = document(load_layout(name))
        if not any(has_key(held) for held in (name, *_held(layout))):
            yield name, layout


def _held(layout: Layout) -> Iterator[str]:
    for field in layout.fields:
        kind = field.kind.item if isinstance(field.kind, Array | Listed) else field.kind
        if isinstance(kind, Layout):
            yield kind.type_name
            yield from _held(kind)


def test_a_type_and_all_that_it_holds_are_told_as_recordings_do(tmp_path: Path) -> None:
    messages = {'Crane': CRANE, 'Hook': 'builtin_interfaces/Time since\n'}
    write_package(tmp_path / 'was', 'acme_msgs', messages)
    crane = document(load_layout('acme_msgs/msg/Crane', [tmp_path / 'was']), [tmp_path / 'was'])
    text = msg_text(crane)
    assert text.startswith('# A crane.\n#   It lifts [t].\n\n# how it is\nuint8 BUSY=1\n')
    assert 'string<=20[<=3] names ["it\'s", \'say "so"\', "a, b"]\n' in text
    assert '\n# the hooks,\n# # all of them\nacme_msgs/Hook[2] hooks\n' in text
    assert f'\n{"=" * 80}\nMSG: acme_msgs/Hook\nbuiltin_interfaces/Time since\n' in text
    assert text.count('MSG: ') == text.count('=' * 80) == 2
    back = _written(crane, tmp_path / 'now')
    read = document(load_layout('acme_msgs/msg/Crane', [back]), [back])
    assert repr(read) == repr(crane)  # not all of it is equal to itself: NaN


TEXTS = (
    'it\'s "so"', 'back\\slash', '\\n', 'two\nlines', 'tab\there', ' spaces ', '#', 'a=b', '', '"',
    "'", 'Grüße, 日本 \u2028\x85\0\x1b[2J', 'end\\', '\\"', '# comment\nint32 evil',
)  # fmt: skip


@pytest.mark.parametrize('text', TEXTS)
@pytest.mark.parametrize('wide', [False, True])
def test_a_default_of_any_text_stays_on_its_line_and_is_read_as_it_was(
    text: str,
    wide: bool,  # noqa: FBT001 (a parameter of the test)
    tmp_path: Path,
) -> None:
    layout = _of(
        Field('before', Primitive('bool'), default=True),
        Field('text', String(wide=wide), default=text or None),
        Field('behind', Primitive('uint64'), default=18446744073709551615),
    )
    [written] = msg_files(layout).values()
    assert len(written.splitlines()) == 3
    assert '\x1b' not in written
    assert _back(layout, tmp_path).fields == layout.fields


def test_a_build_of_ros_reads_the_same_defaults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of the others ROS makes .idl files that it cannot read.
    texts = [text for text in TEXTS if text and not {*'\n\\'} & {*text}]
    layout = _of(*(Field(f't{at}', String(), text) for at, text in enumerate(texts)))
    package = _written(layout, tmp_path / 'source') / 'acme_msgs'
    install_package(package, tmp_path / 'prefix')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    assert load_layout('acme_msgs/msg/Odd').fields == layout.fields


@pytest.mark.parametrize(
    'layout',
    [
        _of(),
        _of(Field('a', Listed(String(5), 3), default=('', 'ab'))),
        _of(Field('a', Array(String(5, wide=True), 2))),
        _of(Field('a', Listed(Primitive('byte')), default=())),
        _of(Field('a', Array(Primitive('bool'), 2), default=(True, False))),
        _of(Field('a', Primitive('float32'), default=float('-inf'))),
        _of(Field('a', Primitive('int64'), default=-(2**63))),
    ],
)
def test_odd_types_are_read_again_as_they_were(layout: Layout, tmp_path: Path) -> None:
    back = _back(layout, tmp_path)
    assert back.fields == layout.fields
    assert back.type_hash


@pytest.mark.parametrize(
    ('field', 'words'),
    [
        (Field('Upper', Primitive('bool')), "acme_msgs/msg/Odd.msg:1: 'bool Upper': 'Upper' is"),
        (Field('a__b', Primitive('bool')), 'is an invalid field name'),
        (Field('a', Array(Primitive('bool'), 0)), 'the size of array type'),
        (
            Field('a', Listed(String()), default=('a\nint32 b',)),
            r"'a\nint32 b' cannot stand in a list",
        ),
        (Field('a', Listed(String()), default=('#',)), "'#' cannot stand in a list"),
        (Field('a', Listed(String()), default=(' a',)), "' a' cannot stand in a list"),
        (Field('a', Listed(String()), default=("'a'",)), 'read as another definition'),
        (Field('a', Listed(String()), default=('b\\',)), 'incorrectly quoted'),
        (Field('a', String(3), default='a=b'), 'must not exceed the maximum length'),
        (Field('a', Layout('acme_msgs/msg/odd', ())), "'odd' is an invalid message name"),
        (Field('a', Layout('test_msgs/msg/KeyedLong', ())), 'fields of it are a DDS key'),
    ],
)
def test_what_a_msg_file_cannot_say_is_told_and_not_written(field: Field, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        msg_files(_of(field))
    assert ' cannot be written as .msg: ' in str(caught.value)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)
    assert 'tmp' not in str(caught.value)


def test_a_hash_that_is_not_that_of_the_fields_is_told() -> None:
    layout = Layout('acme_msgs/msg/Odd', (), type_hash='RIHS01_0')
    with pytest.raises(ConfigError, match='its hash is RIHS01_0, that of its fields is RIHS01_'):
        msg_files(layout)


def test_constants_are_read_again_too() -> None:
    constants = (
        Constant('A', String(), 'a = "#"\\\n'),
        Constant('B', Primitive('float64'), -0.5, 'half'),
    )
    [text] = msg_files(Layout('acme_msgs/msg/Odd', (), constants, 'all')).values()
    assert (
        text == '# all\n\nstring A="a \\x3d \\x22\\x23\\x22\\x5c\\x0a"\n\n# half\nfloat64 B=-0.5\n'
    )
