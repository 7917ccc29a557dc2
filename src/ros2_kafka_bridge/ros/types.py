"""Message types that rclpy publishes and subscribes to: built packages, loaded."""

import importlib
from typing import Any, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String


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


def load_type(name: str) -> MessageType:
    """Load a message type.

    Raises:
        ConfigError: There is no such type, its package cannot be imported, or what is imported
            is not what its description says.
    """
    layout = load_layout(name)
    python_class = _import(name)
    _check(layout, python_class)
    return MessageType(name, python_class, layout, layout.type_hash)


def _import(name: str) -> type[Any]:
    package, _, type_name = name.split('/')
    try:
        python_class: type[Any] = getattr(importlib.import_module(f'{package}.msg'), type_name)
    except (ImportError, AttributeError) as error:
        raise ConfigError([f'message type {name} cannot be loaded: {error}']) from error
    return python_class


def _check(layout: Layout, python_class: Any) -> None:
    """Refuse a class of another build: the path of Python may hide the one that was described."""
    described = {field.name: _spelled(field.kind) for field in layout.fields}
    if described != python_class.get_fields_and_field_types():
        file = importlib.import_module(python_class.__module__).__file__
        problem = f'{layout.type_name} is described otherwise than its class in {file}'
        hint = 'AMENT_PREFIX_PATH and PYTHONPATH lead to different builds of its package'
        raise ConfigError([f'{problem}: {hint}'])
    for inner in dict.fromkeys(_held(layout)):
        _check(inner, _import(inner.type_name))


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
