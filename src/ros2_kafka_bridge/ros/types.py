"""Message types by name.

Which types there are is read from the ament index, so that a configuration is checked without
loading ROS. A type is loaded when its route starts.
"""

import difflib
import importlib
import json
import os
import re
import sys
import sysconfig
from pathlib import Path
from typing import Any, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.layout import (
    Array,
    Field,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
)


class MessageType(NamedTuple):
    """One message type, loaded.

    Args:
        name: As `std_msgs/msg/String`.
        python_class: What rclpy asks for.
        type_hash: `RIHS01_` and 64 hex digits (REP 2011), None where the package ships none.
    """

    name: str
    python_class: type[Any]
    layout: Layout
    type_hash: str | None


def type_names() -> list[str]:
    """All installed message types, sorted; no ROS library is loaded for it."""
    index = 'share/ament_index/resource_index/rosidl_interfaces'
    packages = [file for prefix in _prefixes() for file in (prefix / index).glob('*')]
    return sorted(
        {
            f'{package.name}/{line.rpartition(".")[0]}'
            for package in packages
            for line in package.read_text(encoding='utf-8').split()
            if line.startswith('msg/') and '.' in line
        }
    )


def unknown_type(name: str) -> str | None:
    """Say what is wrong with the name of a type and what is near it; None if it exists."""
    names = type_names()
    if name in names:
        return None
    near = _near(name, names)
    if near:
        hint = f' (did you mean {near}?)'
    elif names:
        hint = ''
    else:
        hint = ': no ROS 2 messages are installed (source a ROS 2, or install the extra [ros])'
    if not re.fullmatch(r'\w+/msg/\w+', name, re.ASCII):
        return f'{name or "an empty name"} is not of the form pkg/msg/Type{hint}'
    return f'no message type {name} here{hint}'


def load_type(name: str) -> MessageType:
    """Load a message type.

    Raises:
        ConfigError: There is no such type, or its package cannot be imported.
    """
    problem = unknown_type(name)
    if problem:
        raise ConfigError([problem])
    python_class = _import(name)
    return MessageType(name, python_class, _layout(name, python_class), _type_hash(name))


def _prefixes() -> list[Path]:
    """Where ROS packages lie: a sourced ROS 2 first; wheels put share/ beside Python's lib/."""
    sourced = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    wheels = [sys.prefix, sysconfig.get_path('data')]
    return [Path(prefix) for prefix in dict.fromkeys(sourced + wheels) if prefix]


def _near(name: str, names: list[str]) -> str | None:
    """The installed type that was probably meant, also by `std_msgs.msg.string` and the like."""
    words = [word for word in re.split(r'\W+', name.lower()) if word]
    if not words:
        return None
    by_lower = {known.lower(): known for known in names}
    wanted = f'{words[0]}/msg/{words[-1]}'
    found = difflib.get_close_matches(wanted, by_lower, n=1, cutoff=0.8)
    found = found or [known for known in by_lower if known.endswith(f'/{words[-1]}')]
    return by_lower[found[0]] if found else None


def _import(name: str) -> type[Any]:
    package, _, type_name = name.split('/')
    try:
        python_class: type[Any] = getattr(importlib.import_module(f'{package}.msg'), type_name)
    except (ImportError, AttributeError) as error:
        raise ConfigError([f'message type {name} cannot be loaded: {error}']) from error
    return python_class


def _layout(name: str, python_class: Any) -> Layout:
    names = python_class.get_fields_and_field_types()
    kinds = (_kind(slot) for slot in python_class.SLOT_TYPES)
    return Layout(name, tuple(Field(*pair) for pair in zip(names, kinds, strict=True)))


_BASIC = {
    'boolean': 'bool',
    'octet': 'byte',
    'float': 'float32',
    'double': 'float64',
}


def _kind(slot: Any) -> Kind:
    """What one of the SLOT_TYPES of a message class lays down."""
    from rosidl_parser import definition as idl  # noqa: PLC0415 -- comes with ROS

    match slot:
        case idl.BasicType():
            return Primitive(_BASIC.get(slot.typename, slot.typename))
        case idl.AbstractString() | idl.AbstractWString():
            return String(_bound(slot), wide=isinstance(slot, idl.AbstractWString))
        case idl.Array():
            return Array(_kind(slot.value_type), slot.size)
        case idl.AbstractSequence():
            return Sequence(_kind(slot.value_type), _bound(slot))
        case idl.NamespacedType():
            name = '/'.join(slot.namespaced_name())
            return _layout(name, _import(name))
        case _:
            raise ConfigError([f'messages with a field of {slot!r} cannot be carried'])


def _bound(slot: Any) -> int | None:
    return getattr(slot, 'maximum_size', None)


def _type_hash(name: str) -> str | None:
    for prefix in _prefixes():
        file = prefix / 'share' / f'{name}.json'
        if file.is_file():
            hashes = json.loads(file.read_text(encoding='utf-8')).get('type_hashes', [])
            found = {entry['type_name']: str(entry['hash_string']) for entry in hashes}
            return found.get(name)
    return None
