"""How the routes of a bridge are shared out among its workers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ros2_kafka_bridge.config.settings import Config


class Share(NamedTuple):
    """The routes of one worker, all in one direction."""

    routes: tuple[str, ...]
    to_ros: bool


def share_out(to_ros: Sequence[str], from_ros: Sequence[str], workers: int) -> list[Share]:
    """Give each worker its routes: the directions in proportion, then route by route in turn.

    No worker has both directions, because the routes to ROS drain first.

    Args:
        to_ros: Names of the routes to ROS.
        from_ros: Names of the routes from ROS.
        workers: How many there are to be, at most one for each route.
    """
    total = len(to_ros) + len(from_ros)
    workers = min(workers, total)
    first = round(workers * len(to_ros) / total)
    if to_ros and from_ros:
        first = min(max(first, 1), workers - 1)
    last = workers - first
    return [
        *(Share(tuple(to_ros[number::first]), to_ros=True) for number in range(first)),
        *(Share(tuple(from_ros[number::last]), to_ros=False) for number in range(last)),
    ]


def supervised(config: 'Config', chosen: frozenset[str] | None = None) -> list[str]:
    """The supervisor's arguments for a configuration; none where one process runs it.

    Args:
        config: The configuration.
        chosen: Names of the routes to run; None runs all.
    """
    from ros2_kafka_bridge.config.settings import KafkaToRosRoute  # noqa: PLC0415 (heavy)

    routes = [route for route in config.routes if chosen is None or route.name in chosen]
    if min(config.workers, len(routes)) < 2:
        return []
    names: dict[bool, list[str]] = {True: [], False: []}
    for route in routes:
        names[isinstance(route, KafkaToRosRoute)].append(route.name)
    return [
        f'--workers={config.workers}',
        f'--drain-s={max(route.drain_s for route in routes)}',
        *(f'--to-ros={name}' for name in names[True]),
        *(f'--from-ros={name}' for name in names[False]),
    ]
