"""How the routes of a bridge are shared out among its workers."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple


class Rank(IntEnum):
    """When a worker drains: the routes to ROS first, so that nobody's last message is lost."""

    TO_ROS = 0
    BOTH = 1
    FROM_ROS = 2


class Share(NamedTuple):
    """The routes of one worker.

    Args:
        routes: Their names.
        to_ros: Whether they lead to ROS, else from there.
        both: Whether they lead both ways: such a worker drains in the right order by itself.
    """

    routes: tuple[str, ...]
    to_ros: bool
    both: bool = False

    @property
    def rank(self) -> Rank:
        """When the worker drains."""
        if self.both:
            return Rank.BOTH
        return Rank.TO_ROS if self.to_ros else Rank.FROM_ROS


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
        both = bool(to_ros and from_ros)
        return [Share((*to_ros, *from_ros), to_ros=bool(to_ros), both=both)]
    first = round(workers * len(to_ros) / total) if total else 0
    if to_ros and from_ros:
        first = min(max(first, 1), workers - 1)
    last = workers - first
    return [
        *(Share(tuple(to_ros[number::first]), to_ros=True) for number in range(first)),
        *(Share(tuple(from_ros[number::last]), to_ros=False) for number in range(last)),
    ]
