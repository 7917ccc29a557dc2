"""Message types as rclpy loads them, held against their descriptions."""

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rosidl_parser import definition as idl
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.message_types import load_layout, type_names
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String
from ros2_kafka_bridge.ros.types import load_type

EVERY_TYPE = pytest.mark.parametrize('name', type_names())
BASIC = {'boolean': 'bool', 'octet': 'byte', 'float': 'float32', 'double': 'float64'}


def fits(slot: Any, kind: Kind) -> bool:
    """Whether one of the SLOT_TYPES of a message class, from its .idl file, is of a kind."""
    match slot:
        case idl.BasicType():
            return kind == Primitive(BASIC.get(slot.typename, slot.typename))
        case idl.AbstractString():
            return kind == String(getattr(slot, 'maximum_size', None))
        case idl.AbstractWString():
            return kind == String(getattr(slot, 'maximum_size', None), wide=True)
        case idl.Array():
            same = isinstance(kind, Array) and kind.length == slot.size
        case idl.AbstractSequence():
            bound = getattr(slot, 'maximum_size', None)
            same = isinstance(kind, Sequence) and kind.bound == bound
        case _:
            return isinstance(kind, Layout) and kind.type_name == '/'.join(slot.namespaced_name())
    return same and isinstance(kind, Array | Sequence) and fits(slot.value_type, kind.item)


def plain(value: Any) -> Any:
    """A value of a message as a default has it."""
    match value:
        case bytes():
            return value[0]
        case list() | tuple() | np.ndarray():
            return tuple(plain(item) for item in value)
        case np.generic():
            return value.item()
        case _:
            return tuple(value) if hasattr(value, 'typecode') else value


@EVERY_TYPE
def test_every_type_loads_with_the_layout_of_its_class_and_its_hash(name: str) -> None:
    loaded = load_type(name, 'import')
    assert loaded.name == loaded.layout.type_name == name
    assert loaded.endpoint_class.__name__ == name.split('/')[2]
    assert re.fullmatch('RIHS01_[0-9a-f]{64}', loaded.type_hash or '')
    assert loaded.type_hash == loaded.layout.type_hash
    made = load_type(name)
    assert (made.layout, made.type_hash) == (loaded.layout, loaded.type_hash)
    names = loaded.endpoint_class.get_fields_and_field_types()
    assert [field.name for field in loaded.layout.fields] == list(names)
    slots = loaded.endpoint_class.SLOT_TYPES
    for field, slot in zip(loaded.layout.fields, slots, strict=True):
        assert fits(slot, field.kind), field


@EVERY_TYPE
def test_a_new_message_has_the_defaults_of_the_layout(name: str) -> None:
    loaded = load_type(name, 'import')
    message = loaded.endpoint_class()
    for field in loaded.layout.fields:
        if field.default is not None:
            assert plain(getattr(message, field.name)) == field.default


def test_a_package_whose_python_part_is_missing_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = write_package(tmp_path / 'src', 'acme_msgs', {'Crane': 'float64 height\n'})
    install_package(package, tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:/does/not/exist')
    with pytest.raises(RouteError, match='acme_msgs/msg/Crane cannot be loaded: No module'):
        load_type('acme_msgs/msg/Crane', 'import')


@pytest.mark.parametrize(
    ('name', 'text'),
    [('Crane', 'float32 height\n'), ('Crane', ''), ('Yard', 'Crane[] cranes\n')],
)
def test_a_class_of_another_build_is_refused(
    name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = {'Crane': 'float32 height\n', name: text}
    install_package(write_package(tmp_path / 'src', 'acme_msgs', messages), tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    module = ModuleType('acme_msgs.msg')
    module.__file__ = '/old/acme_msgs/msg/__init__.py'
    module.Crane = a_class({'height': 'double'})  # type: ignore[attr-defined]
    module.Yard = a_class({'cranes': 'sequence<acme_msgs/Crane>'})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, 'acme_msgs', ModuleType('acme_msgs'))
    monkeypatch.setitem(sys.modules, 'acme_msgs.msg', module)
    with pytest.raises(ConfigError, match='Crane is described otherwise than its class in /old/'):
        load_type(f'acme_msgs/msg/{name}', 'import')


def a_class(fields: dict[str, str]) -> type[Any]:
    spelled = classmethod(lambda _class: fields)
    members = {'get_fields_and_field_types': spelled, '__module__': 'acme_msgs.msg'}
    return type('Message', (), members)


def test_an_unknown_type_is_named_with_what_is_near() -> None:
    with pytest.raises(ConfigError) as caught:
        load_type('std_msgs/msg/Strin')
    assert caught.value.problems == [
        'no message type std_msgs/msg/Strin here (did you mean std_msgs/msg/String?)'
    ]


def test_a_hash_that_is_not_that_of_the_description_needs_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the graph shows of an endpoint has to be what the package would show."""
    package = write_package(tmp_path / 'src', 'acme_msgs', {'Crane': 'float64 height\n'})
    install_package(package, tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    name = 'acme_msgs/msg/Crane'
    assert load_type(name).type_hash == load_layout(name).type_hash
    file = tmp_path / 'share' / f'{name}.json'
    file.write_text(file.read_text().replace('RIHS01_', 'RIHS02_'))
    with pytest.raises(RouteError) as raised:
        load_type(name)
    told = f'share/{name}.json tells the hash RIHS02_'
    assert f'{name} cannot be loaded, and its package is needed ({told}' in str(raised.value)
    assert str(raised.value).endswith("): No module named 'acme_msgs'")


@pytest.mark.parametrize(
    ('idl', 'has_one'),
    [
        ('struct T { @key long a; };', True),
        ('struct T {\n  @verbatim (language="comment", text="The @key of \\"it\\".")\n', False),
        ('// @key\n/* @key\n @key */ struct T { long a; };', False),
        ('@verbatim (text="a") @key long a; // "', True),
    ],
)
def test_a_comment_makes_no_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, idl: str, *, has_one: bool
) -> None:
    install_package(write_package(tmp_path / 'src', 'acme_msgs', {'T': 'int32 a\n'}), tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    (tmp_path / 'share/acme_msgs/msg/T.idl').write_text(idl)
    assert has_key('acme_msgs/msg/T') is has_one
