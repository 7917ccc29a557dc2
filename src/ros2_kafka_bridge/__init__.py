"""Moves every message between Kafka and ROS 2, both ways, and loses none that it can know of."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge
    from ros2_kafka_bridge.config.file import load, loads
    from ros2_kafka_bridge.config.settings import Config
    from ros2_kafka_bridge.dedup import Deduplicator, without_repeats
    from ros2_kafka_bridge.errors import (
        BridgeError,
        ConfigError,
        DecodeError,
        EncodeError,
        LoopError,
        RecordError,
        RecordTooLargeError,
        RouteError,
        TimestampError,
        TransportError,
    )
    from ros2_kafka_bridge.route.counters import Snapshot, State

__version__ = '0.1.0'

__all__ = [
    'Bridge',
    'BridgeError',
    'Config',
    'ConfigError',
    'DecodeError',
    'Deduplicator',
    'EncodeError',
    'LoopError',
    'RecordError',
    'RecordTooLargeError',
    'RouteError',
    'Snapshot',
    'State',
    'TimestampError',
    'TransportError',
    '__version__',
    'load',
    'loads',
    'without_repeats',
]

_HOMES = {
    'Bridge': 'bridge',
    'Config': 'config.settings',
    'Deduplicator': 'dedup',
    'Snapshot': 'route.counters',
    'State': 'route.counters',
    'load': 'config.file',
    'loads': 'config.file',
    'without_repeats': 'dedup',
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is asked for: the command line starts without the rest."""
    from importlib import import_module  # noqa: PLC0415

    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOMES.get(name, "errors")}'), name)
