"""What is wrong between the consumer groups of the routes of one file."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import look
from ros2_kafka_bridge.config.mistakes import Mistake
from ros2_kafka_bridge.kafka.names import lock_group, reading_group


def group_mistakes(bridge: str, routes: Sequence[Any]) -> Iterator[Mistake]:
    """Routes that would get in each other's way at the broker.

    Args:
        bridge: Its name.
        routes: Of the file, with the defaults; unchecked where something is wrong.
    """
    groups = [_groups_of(bridge, route) for route in routes]
    yield from _shared_topics(groups)
    yield from _taken_locks(groups)


class _Groups(NamedTuple):
    """The consumer groups of a route.

    Args:
        topic: What it reads of Kafka; None where it reads ROS.
        reads: The group that it reads in.
        said: Whether the file says that one.
        lock: The group by which bridges agree on who runs it; None where it is not exclusive.
    """

    topic: str | None
    reads: str
    said: bool
    lock: str | None


def _groups_of(bridge: str, route: Any) -> _Groups:
    name, group = look(route, 'name'), look(route, 'from', 'group')
    said = isinstance(group, str)
    exclusive = look(route, 'exclusive') is True
    return _Groups(
        topic=look(route, 'from', 'kafka'),
        reads=group if said else reading_group(bridge, name),
        said=said,
        lock=lock_group(bridge, name) if exclusive else None,
    )


def _shared_topics(groups: Sequence[_Groups]) -> Iterator[Mistake]:
    readers = [(it.reads, it.topic) if it.topic else None for it in groups]
    for number, first in checks.repeats(readers).items():
        at, other = (number, first) if groups[number].said else (first, number)
        if groups[at].said:  # otherwise they share their name, too, which is told already
            text = (
                f'routes[{other}] reads this topic in the same group: each would get a part only'
            )
            yield Mistake(('routes', at, 'from', 'group'), text)


def _taken_locks(groups: Sequence[_Groups]) -> Iterator[Mistake]:
    locks = {it.lock: number for number, it in enumerate(groups) if it.lock}
    for number, it in enumerate(groups):
        if it.topic and it.reads in locks:
            path, cure = (('from', 'group'), '') if it.said else (('name',), 'name, or from.')
            text = (
                f'would read in the group {it.reads}, by which bridges agree on who runs '
                f'routes[{locks[it.reads]}] (exclusive): give it another {cure}group'
            )
            yield Mistake(('routes', number, *path), text)
