"""Which KEEP_LAST depth a ROS reader needs for its traffic.

`ServiceTimes` records how long the reader's callback takes; it needs nothing but Python.
`replay`, `predict` and `choose` answer the question; they need the extra `depth`. No Kafka
and no ROS: where the numbers come from, the command knows.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ros2_kafka_bridge.depth.choice import Choice, Prediction, Workload, choose, load, predict
    from ros2_kafka_bridge.depth.queue import Replay, replay, resample
    from ros2_kafka_bridge.depth.recorder import ServiceTimes

__all__ = [
    'Choice',
    'Prediction',
    'Replay',
    'ServiceTimes',
    'Workload',
    'choose',
    'load',
    'predict',
    'replay',
    'resample',
]

_HOMES = {
    'ServiceTimes': 'recorder',
    **dict.fromkeys(('Replay', 'replay', 'resample'), 'queue'),
    **dict.fromkeys(('Choice', 'Workload', 'Prediction', 'choose', 'load', 'predict'), 'choice'),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is asked for: the recorder must run without numpy."""
    from importlib import import_module  # noqa: PLC0415

    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)
