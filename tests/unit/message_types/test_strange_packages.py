"""Files of packages that others have installed: an odd one costs its own types, and no others.

Guarantee 6b.
"""

import json
import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout, type_names, unknown_type
from ros2_kafka_bridge.message_types.description import (
    DescribedTypes,
    TypeDescription,
    make_layout,
)

INDEX = 'share/ament_index/resource_index/rosidl_interfaces'
SCOPE = Scope('t', JsonSettings(missing='default'), SchemaSettings(registry=False))

Describe = Callable[..., str]


def field(name: str = 'a', type_id: int = 6, default: str = '', **more: Any) -> dict[str, Any]:
    kind = {'type_id': type_id, 'capacity': 0, 'string_capacity': 0, 'nested_type_name': ''}
    return {'name': name, 'type': kind | more, 'default_value': default}


@pytest.fixture
def describe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Describe:
    """Install a description of odd_msgs/msg/Odd; returns its name."""

    def install(*fields: dict[str, Any], text: str | None = None, **others: Any) -> str:
        name = 'odd_msgs/msg/Odd'
        types = [{'type_name': it, 'fields': held} for it, held in others.pop('types', {}).items()]
        content = {
            'type_description_msg': {
                'type_description': {'type_name': name, 'fields': list(fields)},
                'referenced_type_descriptions': types,
            },
            'type_hashes': [],
        }
        (tmp_path / INDEX).mkdir(parents=True)
        (tmp_path / INDEX / 'odd_msgs').write_text('msg/Odd.msg\nmsg/Odd.idl\n')
        file = tmp_path / 'share' / f'{name}.json'
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps(content) if text is None else text, encoding='utf-8')
        return name

    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    return install


@pytest.mark.parametrize('kind', ['not utf-8', 'folder', 'dangling', 'loop', 'no right', 'hidden'])
def test_a_list_of_types_that_cannot_be_read_hides_no_other_package(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = tmp_path / INDEX
    index.mkdir(parents=True)
    file = index / 'odd_msgs'
    match kind:
        case 'not utf-8':
            file.write_bytes(b'msg/\xff.msg\n')
        case 'folder':
            file.mkdir()
        case 'dangling':
            file.symlink_to(tmp_path / 'nowhere')
        case 'loop':
            file.symlink_to(file)
        case 'no right':
            file.write_text('msg/Odd.msg\n')
            file.chmod(0)
        case _:
            (index / '.odd_msgs.swp').write_bytes(b'b0VIM\xff msg/Odd.msg')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert 'std_msgs/msg/String' in type_names()
    assert load_layout('std_msgs/msg/String').fields[0].name == 'data'
    assert (unknown_type('odd_msgs/msg/Odd') is None) == (kind == 'no right' and not os.getuid())


@pytest.mark.parametrize('line', ['msg/a/b.msg', f'msg/{"A" * 300}.msg', 'msg/\xe9.msg', 'msg/.'])
def test_a_line_that_names_no_type_is_none(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / INDEX).mkdir(parents=True)
    (tmp_path / INDEX / 'odd_msgs').write_text(f'{line}\nmsg/Good.msg\n', encoding='utf-8')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert [it for it in type_names() if it.startswith('odd_')] == ['odd_msgs/msg/Good']


@pytest.mark.parametrize(
    ('odd', 'said'),
    [
        (field('a"b'), "'a\"b' is no name of a field"),
        (field('a\n    import os'), 'is no name of a field'),
        (field('é'), 'is no name of a field'),
        (field('_a'), 'is no name of a field'),
        (field(type_id=54, capacity=-1), 'the length -1 is below 0'),
        (field(type_id=54, capacity=0), 'an array has one element at least'),
        (field(type_id=54, capacity=2**70), 'no description of a message type|above 4294967295'),
        (field(type_id=54, capacity=10**12), 'the length 1000000000000 is below 0 or above'),
        (field(type_id=21, string_capacity=-1), 'the length -1 is below 0'),
        (field(type_id=1), "'' is no name of a type"),
        (field(type_id=1, nested_type_name='pk/msg/a b'), 'is no name of a type|no description'),
        (field(default='"a"'), "the default 'a' does not fit"),
        (field(default='(1, 2)'), r'the default \(1, 2\) does not fit'),
        (field(default='2147483648'), 'the default 2147483648 does not fit'),
        (field(default='-1', type_id=9), 'the default -1 does not fit'),
        (field(default='...'), 'the default Ellipsis does not fit'),
        (field(default='1j'), 'the default 1j does not fit'),
        (field(default='{}'), 'the default {} does not fit'),
        (field(default='2', type_id=15), 'the default 2 does not fit'),
        (field(default='(1,' * 50_000), 'is no literal of Python'),
        (field(default='9' * 5000), 'is no literal of Python'),
        (field(default='(1, "a")', type_id=3 + 144), 'the default .* does not fit'),
        (field(default='(1,)', type_id=3 + 48, capacity=2), 'the default .* does not fit'),
    ],
)
def test_an_odd_field_is_said_with_its_name(
    describe: Describe, odd: dict[str, Any], said: str
) -> None:
    name = describe(odd)
    with pytest.raises(ConfigError, match=said):
        load_layout(name)


def test_a_default_of_a_bool_may_be_a_number(describe: Describe) -> None:
    assert load_layout(describe(field(default='1', type_id=15))).fields[0].default is True


def test_two_fields_of_one_name_are_said(describe: Describe) -> None:
    name = describe(field('a'), field('a'))
    with pytest.raises(ConfigError, match='odd_msgs/msg/Odd has two fields of one name'):
        load_layout(name)


@pytest.mark.parametrize('text', ['{"a":' * 100_000, '[' * 100_000, '', '\x00', 'null'])
def test_a_description_that_is_none_is_said(describe: Describe, text: str) -> None:
    name = describe(text=text)
    with pytest.raises(ConfigError, match=r'Odd\.json: no description of a message type'):
        load_layout(name)


def nested(name: str, count: int) -> list[dict[str, Any]]:
    return [field(f'f{n}', 1, nested_type_name=name) for n in range(count)]


@pytest.mark.parametrize(
    ('depth', 'width', 'said'),
    [(300, 1, 'is nested too deeply: more than 100 types'), (30, 2, 'has more than 10,000 fie')],
)
def test_a_type_that_grows_without_end_is_said(
    describe: Describe, depth: int, width: int, said: str
) -> None:
    names = [f'odd_msgs/msg/T{n}' for n in range(depth)]
    types = {one: nested(other, width) for one, other in pairwise(names)}
    name = describe(*nested(names[0], width), types={**types, names[-1]: [field()]})
    with pytest.raises(ConfigError, match=said):
        load_layout(name)


def test_a_type_that_is_reached_by_a_short_way_and_by_a_long_one_is_as_deep_as_the_long_one(
    describe: Describe,
) -> None:
    """Each chain is short enough: the second holds the first one's beginning at its end."""
    first, second = ([f'odd_msgs/msg/{it}{n}' for n in range(60)] for it in 'AB')
    chain = {one: nested(other, 1) for one, other in pairwise([*second, *first])}
    short = [field('short', 1, nested_type_name=first[0])]
    name = describe(*short, *nested(second[0], 1), types={**chain, first[-1]: [field()]})
    with pytest.raises(ConfigError, match='is nested too deeply: more than 100 types'):
        load_layout(name)


@pytest.mark.parametrize('name', ['../../etc/msg/R', 'a/msg/b/c', 'a/msg/R\n', '', 'a/srv/R'])
def test_a_name_that_is_none_of_a_type_has_no_layout(name: str) -> None:
    """It may come from the graph, and becomes the name of a file."""
    described = DescribedTypes({name: TypeDescription(name, ())}, {})
    with pytest.raises(ConfigError, match='is no name of a message type'):
        make_layout(name, described)


@pytest.mark.parametrize('word', ['from', 'class', 'None', 'self', 'value', 'DESCRIPTOR', 'f0'])
@pytest.mark.parametrize('form', ['cdr', 'json', 'avro', 'protobuf'])
def test_a_field_may_be_called_like_a_word_of_python(
    describe: Describe, word: str, form: str
) -> None:
    layout = load_layout(describe(field(word)))
    encode = FORMATS[form].make_encode(layout, SCOPE)
    decode = FORMATS[form].make_decode(layout, SCOPE)
    message = b'\0\1\0\0\7\0\0\0'
    assert decode(encode(message)) == message


@pytest.mark.parametrize('form', ['json', 'avro', 'protobuf'])
def test_what_a_format_cannot_make_of_a_type_is_said(
    describe: Describe, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = load_layout(describe(field('a')))
    for error in (MemoryError(), SystemExit(1), RuntimeError('odd'), AssertionError()):
        monkeypatch.setattr(f'ros2_kafka_bridge.formats.{form}.make_encode', _raising(error))
        said = f'{form} cannot carry odd_msgs/msg/Odd: {type(error).__name__}'
        with pytest.raises(RouteError, match=said):
            FORMATS[form].make_encode(layout, SCOPE)


def _raising(error: BaseException) -> Callable[..., None]:
    def fail(*_: Any) -> None:
        raise error

    return fail
