"""Docs and constants of types."""

import importlib
from pathlib import Path
from typing import Any

import pytest
from support.ros.package import write_package

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import document, load_layout, type_names
from ros2_kafka_bridge.message_types.layout import Constant, Layout, Primitive, String

CRANE = """\
# A crane of the harbour.
#
#   It turns.

# How tall it is,
# without its flag.
float64 height 2.5   # [m] at noon

string NAME="K\\t1"    # painted
char LETTER=65
int8 LOW=-1
    # the least there is
Hook hook
"""


@pytest.fixture
def harbour(tmp_path: Path) -> Path:
    write_package(tmp_path, 'acme_msgs', {'Crane': CRANE, 'Hook': '# It hangs.\nint8 x # x[0]\n'})
    return tmp_path


def test_comments_become_docs_without_losing_what_is_in_brackets(harbour: Path) -> None:
    layout = document(load_layout('acme_msgs/msg/Crane', [harbour]), [harbour])
    assert layout.doc == 'A crane of the harbour.\n\n  It turns.'
    height, hook = layout.fields
    assert height.doc == 'How tall it is,\nwithout its flag.\n[m] at noon'
    assert height.default == 2.5
    assert isinstance(hook.kind, Layout)
    assert hook.kind.doc == 'It hangs.'
    assert hook.kind.fields[0].doc == 'x[0]'


def test_constants_come_in_their_order_with_their_docs(harbour: Path) -> None:
    layout = document(load_layout('acme_msgs/msg/Crane', [harbour]), [harbour])
    assert layout.constants == (
        Constant('NAME', String(), 'K\t1', 'painted'),
        Constant('LETTER', Primitive('uint8'), 65),
        Constant('LOW', Primitive('int8'), -1, 'the least there is'),
    )


def test_docs_change_nothing_else(harbour: Path) -> None:
    plain = load_layout('acme_msgs/msg/Crane', [harbour])
    layout = document(plain, [harbour])
    assert layout.type_hash == plain.type_hash
    assert layout.fields[0][:3] == plain.fields[0][:3]
    assert document(layout, [harbour]) == layout


@pytest.mark.parametrize('name', type_names())
def test_every_constant_of_an_installed_type_is_the_one_of_its_class(name: str) -> None:
    package, _, short_name = name.split('/')
    python_class: Any = getattr(importlib.import_module(f'{package}.msg'), short_name)
    for constant in document(load_layout(name)).constants:
        found = getattr(python_class, constant.name)
        # A byte is a byte in Python.
        assert (found[0] if isinstance(found, bytes) else found) == constant.value


def test_a_type_with_nothing_but_an_idl_file_has_no_docs() -> None:
    layout = load_layout('test_msgs/msg/KeyedLong')
    assert document(layout) == layout


def test_without_the_parser_of_ros_an_installed_type_has_no_docs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    layout = load_layout('std_msgs/msg/Header')
    assert document(layout).doc
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: None)
    assert document(layout) == layout


def test_a_mistake_in_a_file_is_told(harbour: Path) -> None:
    layout = load_layout('acme_msgs/msg/Hook', [harbour])
    (harbour / 'acme_msgs/msg/Hook.msg').write_text('int8 x y\n')
    with pytest.raises(ConfigError, match=r'Hook\.msg:1: '):
        document(layout, [harbour])
