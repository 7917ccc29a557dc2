"""The class of a message type from its package, which is code of others.

It may be broken, built for another Python, or never end its import.
"""

import importlib
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from ros2_kafka_bridge.errors import ConfigError, RouteError, blamed, fault_of
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String
from ros2_kafka_bridge.ros.type_support.loaded import find_class


def import_class(layout: Layout, why: str = '') -> type[Any]:
    """Import a message class, and load the library that rclpy needs of it.

    Args:
        layout: Of the type.
        why: What its package is needed for, where types of others need none.

    Raises:
        ConfigError: It is not what the layout says.
        RouteError: Its package cannot be imported.
    """
    name = layout.type_name
    needed = f', and its package is needed ({why})' if why else ''
    with blamed(f'message type {name} cannot be loaded{needed}'):
        python_class: type[Any] = find_class(name)
        _check(layout, python_class)
        _load_support(name, python_class)
    return python_class


def _load_support(name: str, python_class: Any) -> None:
    """Load the library of a class, as rclpy does when it makes the first endpoint of it."""
    from rclpy.type_support import check_is_valid_msg_type  # noqa: PLC0415 (heavy)

    try:
        if python_class._TYPE_SUPPORT is None:  # noqa: SLF001 (as rclpy asks)
            python_class.__import_type_support__()
        check_is_valid_msg_type(python_class)
    except Exception as error:
        cause = error.__context__ if isinstance(error.__context__, ImportError) else error
        raise RouteError(_without_support(name, fault_of(cause))) from error


def _without_support(name: str, cause: str) -> str:
    package = name.partition('/')[0]
    folder = Path(str(sys.modules[package].__file__)).parent
    others = sorted(file.name for file in folder.glob(f'{package}_s__rosidl_typesupport_c.*.so'))
    problem = f'message type {name}: the library of its package cannot be loaded: {cause}'
    if others and not any(one.endswith(EXTENSION_SUFFIXES[0]) for one in others):
        version = '.'.join(map(str, sys.version_info[:2]))
        return (
            f'{problem}: there is {", ".join(others)}, and this is Python {version}: build the '
            'package for it'
        )
    return problem


def _check(layout: Layout, python_class: Any) -> None:
    """Refuse a class of another build: the path of Python may hide the one that was described."""
    described = {field.name: _spelled(field.kind) for field in layout.fields}
    if described != python_class.get_fields_and_field_types():
        file = importlib.import_module(python_class.__module__).__file__
        problem = f'{layout.type_name} is described otherwise than its class in {file}'
        hint = 'AMENT_PREFIX_PATH and PYTHONPATH lead to different builds of its package'
        raise ConfigError([f'{problem}: {hint}'])
    for inner in dict.fromkeys(_held(layout)):
        _check(inner, find_class(inner.type_name))


def _held(layout: Layout) -> list[Layout]:
    kinds = [field.kind for field in layout.fields]
    items = [kind.item if isinstance(kind, Array | Sequence) else kind for kind in kinds]
    return [item for item in items if isinstance(item, Layout)]


_SPELLED = {'bool': 'boolean', 'byte': 'octet', 'float32': 'float', 'float64': 'double'}


def _spelled(kind: Kind) -> str:
    """A kind as `get_fields_and_field_types` of a message class spells it."""
    match kind:
        case Primitive():
            return _SPELLED.get(kind.name, kind.name)
        case String():
            bound = '' if kind.bound is None else f'<{kind.bound}>'
            return f'{"w" if kind.wide else ""}string{bound}'
        case Array():
            return f'{_spelled(kind.item)}[{kind.length}]'
        case Sequence():
            bound = '' if kind.bound is None else f', {kind.bound}'
            return f'sequence<{_spelled(kind.item)}{bound}>'
        case Layout():
            package, _, name = kind.type_name.split('/')
            return f'{package}/{name}'
