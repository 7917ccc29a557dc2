"""Message types that endpoints are made of: from a description, or from a package.

Nothing of a package is imported where this ROS takes a type without one (`type_support`).
"""

import threading
import time
from concurrent.futures import Future, wait
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.config.endpoints import Packages
from ros2_kafka_bridge.errors import RouteError, blamed
from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.message_types.description import make_layout, type_hash
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros.type_support.choice import why_import
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class
from ros2_kafka_bridge.ros.type_support.imported import import_class
from ros2_kafka_bridge.threads.stop import Stop

_PATIENCE_S: Final = 10.0
_STEP_S: Final = 0.05


class MessageType(NamedTuple):
    """One message type, loaded.

    Args:
        name: As `std_msgs/msg/String`.
        endpoint_class: What rclpy makes publishers and subscriptions of. It may have no messages:
            bytes are published and taken.
        type_hash: `RIHS01_` and 64 hex digits (REP 2011), None where the package ships none.
    """

    name: str
    endpoint_class: type[Any]
    layout: Layout
    type_hash: str | None


class TypeLoader:
    """Loads message types, each in a thread of its own: an import may never end.

    Args:
        packages: Whether to import their packages where this ROS does without.
        patience_s: How long one is waited for before that is said.
    """

    def __init__(self, packages: Packages = 'as_needed', patience_s: float = _PATIENCE_S) -> None:
        # Found out here, in the thread of the caller: it may take longer than an import.
        self._imports = packages == 'import' or bool(why_import())
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
                    target=_load_into,
                    args=(loading, name, self._imports),
                    name=f'load {name}',
                    daemon=True,
                )
                run.start()
            return self._loading[name]

    def _forget(self, name: str, loading: 'Future[MessageType]') -> None:
        with self._lock:
            if self._loading.get(name) is loading:
                del self._loading[name]


def _load_into(loading: 'Future[MessageType]', name: str, imports: bool) -> None:  # noqa: FBT001
    try:
        loaded = _load(name, imports=imports)
    except BaseException as error:  # noqa: BLE001 (raised by whoever waits)
        loading.set_exception(error)
    else:
        loading.set_result(loaded)


def load_type(name: str, packages: Packages = 'as_needed') -> MessageType:
    """Load a message type for who does nothing else meanwhile.

    Args:
        name: As `std_msgs/msg/String`.
        packages: As of a `TypeLoader`.

    Raises:
        ConfigError, RouteError: As `TypeLoader.load`.
    """
    loaded = TypeLoader(packages).load(name)
    assert loaded is not None, 'nothing stops it'
    return loaded


def _load(name: str, *, imports: bool) -> MessageType:
    described = describe(name)
    layout = make_layout(name, described)
    if imports:
        return MessageType(name, import_class(layout), layout, layout.type_hash)
    computed = type_hash(name, described.types)
    if why := _why_needed(layout, computed):
        return MessageType(name, import_class(layout, why), layout, layout.type_hash)
    with blamed(f'message type {name} cannot be loaded'):
        made = endpoint_class(name, described.types)
    return MessageType(name, made, layout, computed)


def _why_needed(layout: Layout, computed: str) -> str:
    """Why a type needs its package where others need none; empty where it needs none either."""
    if has_key(layout.type_name):
        return 'fields of it are a DDS key'
    if layout.type_hash not in {None, computed}:
        file = f'share/{layout.type_name}.json'
        return f'{file} tells the hash {layout.type_hash}, of its fields it is {computed}'
    return ''
