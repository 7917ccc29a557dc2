"""Message types that rclpy publishes and subscribes to: built packages, loaded.

A package is code of others: it may be broken, built for another Python, or never end its import.
"""

import importlib
import sys
import threading
import time
from concurrent.futures import Future, wait
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError, RouteError, blamed, fault_of
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence, String
from ros2_kafka_bridge.threads.stop import Stop

_PATIENCE_S: Final = 10.0
_STEP_S: Final = 0.05


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


class TypeLoader:
    """Loads message types, each in a thread of its own: an import may never end.

    Args:
        patience_s: How long one is waited for before that is said.
    """

    def __init__(self, patience_s: float = _PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._lock = threading.Lock()
        self._loading: dict[str, Future[MessageType]] = {}

    def load(self, name: str, stop: Stop | None = None) -> MessageType | None:
        """Load a message type; what takes longer goes on, and is waited for by the next call.

        Args:
            name: As `std_msgs/msg/String`.
            stop: Ends the waiting.

        Returns:
            The type; None where a stop came before it was loaded.

        Raises:
            ConfigError: There is no such type, or what is imported is not what its description
                says.
            RouteError: Its package cannot be imported, or not yet.
        """
        loading = self._begun(name)
        until_s = time.monotonic() + self._patience_s
        while not loading.done() and time.monotonic() < until_s:
            if stop is not None and stop.look():
                return None
            wait([loading], _STEP_S)
        if not loading.done():
            raise RouteError(
                f'message type {name}: the import of its package has not ended after '
                f'{self._patience_s:g} s: look at what its modules do there'
            )
        self._forget(name, loading)
        return loading.result()

    def _begun(self, name: str) -> 'Future[MessageType]':
        with self._lock:
            if name not in self._loading:
                loading = self._loading[name] = Future[MessageType]()
                # Not an executor: the end of the process would wait for it.
                run = threading.Thread(
                    target=_load_into, args=(loading, name), name=f'load {name}', daemon=True
                )
                run.start()
            return self._loading[name]

    def _forget(self, name: str, loading: 'Future[MessageType]') -> None:
        with self._lock:
            if self._loading.get(name) is loading:
                del self._loading[name]


def _load_into(loading: 'Future[MessageType]', name: str) -> None:
    try:
        loaded = _load(name)
    except BaseException as error:  # noqa: BLE001 (raised by whoever waits)
        loading.set_exception(error)
    else:
        loading.set_result(loaded)


def load_type(name: str) -> MessageType:
    """Load a message type for who does nothing else meanwhile.

    Raises:
        ConfigError, RouteError: As `TypeLoader.load`.
    """
    loaded = TypeLoader().load(name)
    assert loaded is not None, 'nothing stops it'
    return loaded


def _load(name: str) -> MessageType:
    layout = load_layout(name)
    with blamed(f'message type {name} cannot be loaded'):
        python_class = _import(name)
        _check(layout, python_class)
        _load_support(name, python_class)
    return MessageType(name, python_class, layout, layout.type_hash)


def _import(name: str) -> type[Any]:
    package, _, type_name = name.split('/')
    python_class: type[Any] = getattr(importlib.import_module(f'{package}.msg'), type_name)
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
