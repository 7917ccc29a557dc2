"""What a dead letter holds: a record that can never be delivered, with the reason."""

import time
from typing import NamedTuple

from ros2_kafka_bridge.endpoints import HeaderList, Outgoing
from ros2_kafka_bridge.errors import REASON_CHARS, RecordError
from ros2_kafka_bridge.logs.text import printable

HEADER_LIMIT = 1000
"""Headers of a record that its dead letter keeps; of one that has more, it keeps none."""

_FIRST = 'dead_letter.error'


class Origin(NamedTuple):
    """Where a dead letter comes from; `place` holds the headers that say it."""

    route: str
    place: HeaderList


def from_kafka(route: str, topic: str, partition: int, offset: int) -> Origin:
    """The origin of a record of Kafka."""
    place: HeaderList = [
        ('dead_letter.topic', topic),
        ('dead_letter.partition', str(partition)),
        ('dead_letter.offset', str(offset)),
    ]
    return Origin(route, place)


def from_ros(route: str, ros_topic: str, topic: str) -> Origin:
    """The origin of a message of ROS that was on its way to `topic`."""
    return Origin(route, [('dead_letter.source', ros_topic), ('dead_letter.topic', topic)])


def explain(record: Outgoing, error: RecordError, origin: Origin, unread: str = '') -> Outgoing:
    """Add to a record why it is a dead letter, behind the headers that it has.

    Args:
        record: As it came.
        error: Why it can never be delivered.
        origin: Where it comes from.
        unread: Why its headers could not be read, empty where they could.
    """
    kept = record.headers
    if len(kept) > HEADER_LIMIT:
        kept, unread = [], f'{len(kept)}, more than {HEADER_LIMIT}'
    text = f'{type(error).__name__}: {error}'[:REASON_CHARS]
    reason: HeaderList = [
        (_FIRST, printable(text)),
        ('dead_letter.route', origin.route),
        *origin.place,
        ('dead_letter.time_ns', str(time.time_ns())),
    ]
    if unread:
        reason.append(('dead_letter.headers', f'left out: {unread}'))
    return record._replace(headers=[*kept, *reason])


def without_value(record: Outgoing) -> Outgoing:
    """Leave the value out, and say how long it was."""
    size: HeaderList = [('dead_letter.value_bytes', str(len(record.value or b'')))]
    return record._replace(value=None, headers=[*record.headers, *size])


def smaller(letter: Outgoing) -> Outgoing | None:
    """A letter that is too large, with less of the record in it; None where nothing is left."""
    if letter.value is not None:
        return without_value(letter)
    bare = _bare(letter)
    return None if bare == letter else bare


def _bare(record: Outgoing) -> Outgoing:
    """Leave out all but the reason; headers that look like it may have come with the record."""
    names = [name for name, _ in record.headers]
    begin = len(names) - 1 - names[::-1].index(_FIRST)
    return record._replace(key=None, headers=record.headers[begin:])
