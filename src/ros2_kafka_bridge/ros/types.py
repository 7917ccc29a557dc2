"""Message types that endpoints are made of: from a description, or from a package.

Nothing of a package is imported where this ROS takes a type without one (`type_support`).
"""

import threading
import time
from concurrent.futures import Future, wait
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.config.endpoints import Packages, RosSettings
from ros2_kafka_bridge.errors import ConfigError, RouteError, blamed
from ros2_kafka_bridge.message_types import INSTALLED
from ros2_kafka_bridge.message_types.description import DescribedTypes, make_layout, type_hash
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.source import NOT_SHOWN, Ask, Definitions, TypeSource
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
        origin: Where its description is from, as `is installed here`.
    """

    name: str
    endpoint_class: type[Any]
    layout: Layout
    type_hash: str | None
    origin: str = ''


class WantedType(NamedTuple):
    """A type that is to be loaded.

    Args:
        name: As `std_msgs/msg/String`.
        definitions: As the graph shows them.
        ask: Asks the nodes that use it; None asks nobody.
    """

    name: str
    definitions: Definitions = NOT_SHOWN
    ask: Ask | None = None

    @property
    def place(self) -> '_Place':
        """What tells it from others."""
        return self.name, frozenset(self.definitions)


_Place = tuple[str, frozenset[str]]


class TypeLoader:
    """Loads message types, each in a thread of its own: an import may never end.

    Args:
        ros: Where they are described, and whether their packages are imported where this ROS does
            without.
        patience_s: How long one is waited for before that is said.
    """

    def __init__(self, ros: RosSettings, patience_s: float = _PATIENCE_S) -> None:
        # Found out here, in the thread of the caller: it may take longer than an import.
        self._why_import = _why_import(ros.packages)
        # What is imported has the fields of its package, whatever a folder says.
        self._source = TypeSource(() if self._why_import else ros.message_path)
        self._patience_s = patience_s
        self._lock = threading.Lock()
        self._loading: dict[_Place, Future[MessageType]] = {}

    def unsettled(self, name: str) -> str | None:
        """Why those who use a type have to show how it is defined; None where they need not."""
        return None if self._why_import else self._source.unsettled(name)

    def load(self, wanted: WantedType, stop: Stop | None = None) -> MessageType | None:
        """Load a message type; what takes longer goes on, and is waited for by the next call.

        Args:
            wanted: The type.
            stop: Ends the waiting.

        Returns:
            The type; None where a stop came before it was loaded.

        Raises:
            ConfigError: There is no such type, or what is imported is not what its description
                says.
            RouteError: Nobody describes it; or its package cannot be imported, or not yet.
        """
        loading = self._begun(wanted)
        until_s = time.monotonic() + self._patience_s
        while not loading.done() and time.monotonic() < until_s:
            if stop is not None and stop.asked:
                return None
            wait([loading], _STEP_S)
        if not loading.done():
            raise self._takes_long(wanted.name)
        self._forget(wanted.place, loading)
        return loading.result()

    def _takes_long(self, name: str) -> RouteError:
        if not self._why_import:
            return RouteError(
                f'message type {name} has not been loaded after {self._patience_s:g} s: is this '
                'machine overloaded?'
            )
        return RouteError(
            f'message type {name}: the import of its package has not ended after '
            f'{self._patience_s:g} s: look at what its modules do there'
        )

    def _begun(self, wanted: WantedType) -> 'Future[MessageType]':
        place = wanted.place
        with self._lock:
            if place not in self._loading:
                loading = self._loading[place] = Future[MessageType]()
                # Not an executor: the end of the process would wait for it.
                run = threading.Thread(
                    target=self._load_into,
                    args=(loading, wanted),
                    name=f'load {wanted.name}',
                    daemon=True,
                )
                run.start()
            return self._loading[place]

    def _forget(self, place: '_Place', loading: 'Future[MessageType]') -> None:
        with self._lock:
            if self._loading.get(place) is loading:
                del self._loading[place]

    def _load_into(self, loading: 'Future[MessageType]', wanted: WantedType) -> None:
        try:
            loaded = self._load(wanted)
        except BaseException as error:  # noqa: BLE001 (raised by whoever waits)
            loading.set_exception(error)
        else:
            loading.set_result(loaded)

    def _load(self, wanted: WantedType) -> MessageType:
        name = wanted.name
        if self._why_import:
            return _of_package(name, self._source, self._why_import)
        described = self._source.describe(*wanted)
        layout = make_layout(name, described)
        computed = type_hash(name, described.types)
        if why := _why_needed(layout, computed, described):
            return MessageType(
                name, import_class(layout, why), layout, layout.type_hash, described.origin
            )
        with blamed(f'message type {name} cannot be loaded'):
            made = endpoint_class(name, described.types)
        return MessageType(name, made, layout, computed, described.origin)


def load_type(name: str, packages: Packages = 'as_needed') -> MessageType:
    """Load a message type that is installed, for who does nothing else meanwhile.

    Args:
        name: As `std_msgs/msg/String`.
        packages: As of the settings.

    Raises:
        ConfigError, RouteError: As `TypeLoader.load`.
    """
    loaded = TypeLoader(RosSettings(packages=packages)).load(WantedType(name))
    assert loaded is not None, 'nothing stops it'
    return loaded


def _why_import(packages: Packages) -> str:
    return 'ros.packages is import' if packages == 'import' else why_import()


def _of_package(name: str, source: TypeSource, why: str) -> MessageType:
    """A type as its package has it.

    Raises:
        ConfigError: Its package is not installed, or is not what its description says.
        RouteError: It cannot be imported.
    """
    try:
        described = source.describe(name)
    except ConfigError as error:
        cure = f'its package has to be installed here, built and sourced ({why})'
        raise ConfigError([f'{problem}: {cure}' for problem in error.problems]) from error
    layout = make_layout(name, described)
    return MessageType(name, import_class(layout), layout, layout.type_hash, described.origin)


def _why_needed(layout: Layout, computed: str, described: DescribedTypes) -> str:
    """Why a type needs its package where others need none; empty where it needs none either."""
    if described.origin != INSTALLED:
        return ''
    if has_key(layout.type_name):
        return 'fields of it are a DDS key'
    if layout.type_hash not in {None, computed}:
        file = f'share/{layout.type_name}.json'
        return f'{file} tells the hash {layout.type_hash}, of its fields it is {computed}'
    return ''
