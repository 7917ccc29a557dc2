"""What the processes of a bridge know of its configuration, without what reads and checks one."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import msgspec

from ros2_kafka_bridge.config.direction import Direction

if TYPE_CHECKING:
    from pathlib import Path

    from ros2_kafka_bridge.config.settings import Config

OFF: Final = 'off'


class Rank(IntEnum):
    """When a worker drains: the routes to ROS first, so that nobody's last message is lost."""

    TO_ROS = 0
    BOTH = 1
    FROM_ROS = 2


class Share(NamedTuple):
    """The routes of one worker.

    Args:
        routes: Their names.
        rank: When it drains; one whose routes go both ways drains in the right order by itself.
    """

    routes: tuple[str, ...]
    rank: Rank


class RoutePlan(msgspec.Struct, frozen=True):
    """A route, as its supervisor sees it."""

    name: str
    direction: Direction
    drain_s: float


class MonitoringPlan(msgspec.Struct, frozen=True):
    """What a supervisor does itself of what watches the bridge."""

    listen: str
    start: Literal['active', 'unconfigured']


class Plan(msgspec.Struct, frozen=True):
    """A checked configuration. It holds secrets.

    Args:
        file: Its name.
        values: All its settings, with what is read from the environment and from other files.
        routes: Those that this bridge runs, in the order of the file.
        chosen: Their names where the command line names them.
        workers: How many processes share them.
        monitoring: None where nothing watches the bridge.
    """

    file: str
    values: dict[str, Any]
    routes: tuple[RoutePlan, ...]
    chosen: tuple[str, ...] = ()
    workers: int = 1
    monitoring: MonitoringPlan | None = None

    @property
    def config(self) -> 'Config':
        """The configuration, without what has checked it."""
        from ros2_kafka_bridge.config.settings import restored  # noqa: PLC0415 (heavy)

        return restored(self.values)

    @property
    def names(self) -> list[str]:
        """The names of its routes."""
        return [route.name for route in self.routes]

    @property
    def drain_s(self) -> float:
        """The longest drain of all routes."""
        return max((route.drain_s for route in self.routes), default=0.0)

    @property
    def supervised(self) -> bool:
        """Whether a process of its own stands above those that run the routes."""
        return self.monitoring is not None or min(self.workers, len(self.routes)) > 1

    def shares(self) -> list[Share]:
        """The routes of each worker at the start."""
        return share_out(*self.directions(set(self.names)), self.workers)

    def directions(self, names: set[str]) -> tuple[list[str], list[str]]:
        """Those names that lead to ROS, and those that come from there."""
        found: dict[Direction, list[str]] = {direction: [] for direction in Direction}
        for route in self.routes:
            if route.name in names:
                found[route.direction].append(route.name)
        return found[Direction.KAFKA_TO_ROS], found[Direction.ROS_TO_KAFKA]


def plan_of(config: 'Config', file: 'Path', chosen: frozenset[str] | None = None) -> Plan:
    """The plan of a configuration.

    Args:
        config: The configuration.
        file: Its file.
        chosen: Names of the routes to run; None runs all.
    """
    from ros2_kafka_bridge.config.validation import plain  # noqa: PLC0415 (heavy)

    routes = [route for route in config.routes if chosen is None or route.name in chosen]
    monitoring = config.monitoring
    return Plan(
        str(file),
        plain(config),
        tuple(RoutePlan(r.name, r.direction, r.drain_s) for r in routes),
        () if chosen is None else tuple(route.name for route in routes),
        config.workers,
        None if monitoring is None else MonitoringPlan(monitoring.listen, monitoring.start),
    )


def write_plan(plan: Plan) -> int:
    """Write it into a file in memory that other processes may inherit; returns its descriptor."""
    descriptor = os.memfd_create('plan')  # secrets stand in it
    try:
        with open(descriptor, 'wb', closefd=False) as file:
            file.write(msgspec.json.encode(plan))
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_plan(descriptor: int) -> Plan:
    """Read it from such a file.

    Raises:
        ValueError: There is none.
    """
    size_bytes, data = os.fstat(descriptor).st_size, b''
    while len(data) < size_bytes:  # wherever another reader of it has come to
        data += os.pread(descriptor, size_bytes - len(data), len(data))
    return msgspec.json.decode(data, type=Plan)


@contextmanager
def held_plan(plan: Plan) -> Iterator[int]:
    """A file in memory with the plan, for as long as `with` lasts."""
    descriptor = write_plan(plan)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def share_out(to_ros: Sequence[str], from_ros: Sequence[str], workers: int) -> list[Share]:
    """Give each worker its routes: the directions in proportion, then route by route in turn.

    No worker has both directions, because the routes to ROS drain first; but for the only one.

    Args:
        to_ros: Names of the routes to ROS.
        from_ros: Names of the routes from ROS.
        workers: How many there are to be, at most one for each route.
    """
    total = len(to_ros) + len(from_ros)
    workers = min(workers, total)
    if workers == 1:
        rank = Rank.BOTH if to_ros and from_ros else Rank.TO_ROS if to_ros else Rank.FROM_ROS
        return [Share((*to_ros, *from_ros), rank)]
    first = round(workers * len(to_ros) / total) if total else 0
    if to_ros and from_ros:
        first = min(max(first, 1), workers - 1)
    last = workers - first
    return [
        *(Share(tuple(to_ros[number::first]), Rank.TO_ROS) for number in range(first)),
        *(Share(tuple(from_ros[number::last]), Rank.FROM_ROS) for number in range(last)),
    ]
