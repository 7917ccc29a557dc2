"""A record of a dead-letter topic: a letter, the mark of a replay, or something of somebody else.

A letter is the record as it was, with a block of headers behind its own:

    dead_letter.error .route (.topic .partition .offset | .source .topic) .time_ns (.value_bytes)

A mark says that a letter of the same partition was replayed. It is written together with what was
replayed, has no headers but these, and an empty value:

    dead_letter.replayed (offset of the letter) .to (where to) .time_ns
"""

import re
import time
from typing import Final, NamedTuple

from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, Record, headers_of

PREFIX: Final = 'dead_letter.'
_MARK: Final = ('dead_letter.replayed', 'dead_letter.to', 'dead_letter.time_ns')
_NUMBER: Final = re.compile(r'\d{1,19}', re.ASCII)
_LONGEST_NAME: Final = 255  # of a topic, and of a route
_PLACE: Final = re.compile(r'(?P<topic>[^\[\]@]+)\[(?P<partition>\d{1,9})\]@(?P<offset>\d{1,18})')


class LetterPlace(NamedTuple):
    """Where a record lies."""

    topic: str
    partition: int
    offset: int

    def __str__(self) -> str:
        return f'{self.topic}[{self.partition}]@{self.offset}'

    @classmethod
    def parse(cls, text: str) -> 'LetterPlace | None':
        """Read it as it is printed; None for anything else."""
        found = _PLACE.fullmatch(text)
        return found and cls(found['topic'], int(found['partition']), int(found['offset']))


class Explanation(NamedTuple):
    """What a bridge says of a letter, in the headers that `explain` adds.

    Args:
        reason: Class and text of the error.
        topic: The Kafka topic that the record was read from, or was on its way to.
        partition: Of the record in that topic; None for a message of ROS.
        offset: The same.
        ros_topic: Where the message came from; empty for a record of Kafka.
        time_ns: When it failed, since 1970.
        value_bytes: The size of the value where that was left out.
    """

    reason: str
    route: str
    topic: str
    partition: int | None
    offset: int | None
    ros_topic: str
    time_ns: int
    value_bytes: int | None

    @property
    def source(self) -> str:
        """Where it came from, in short."""
        if self.ros_topic:
            return self.ros_topic
        return f'{self.topic}[{self.partition}]@{self.offset}'


class Letter(NamedTuple):
    """A record of a dead-letter topic that is no mark.

    Args:
        place: Where it lies.
        time_ms: The timestamp of the record, since 1970.
        key: As it was.
        value: As it was; None where it was null, or was left out.
        headers: Those of the record itself.
        about: What the bridge says of it; None where it is not a bridge's letter.
        size_bytes: Of the value, also of one that was left out.
    """

    place: LetterPlace
    time_ms: int
    key: bytes | None
    value: bytes | None
    headers: HeaderList
    about: Explanation | None
    size_bytes: int

    def told(self, header: str) -> str:
        """The text of a header; empty where there is none."""
        return _text(dict(self.headers).get(header))


class Mark(NamedTuple):
    """Tells that a letter was replayed.

    Args:
        letter: Where the letter lies.
        to: Where it went to: a Kafka topic, or `ros:/topic`.
        time_ns: When, since 1970.
    """

    letter: LetterPlace
    to: str
    time_ns: int


def parse(topic: str, record: Record) -> Letter | Mark:
    """Read what a record of a dead-letter topic is.

    Headers that somebody has written into the record before it failed say nothing: the bridge
    adds its own behind them.
    """
    place = LetterPlace(topic, record.partition() or 0, record.offset() or 0)
    headers = headers_of(record) or []
    if mark := _mark(place, headers):
        return mark
    begin = _block_begins(headers)
    about = None if begin is None else _about(headers[begin:])
    own = headers if about is None else headers[:begin]
    kind, time_ms = record.timestamp()
    value = record.value()
    left_out = about.value_bytes if about else None
    return Letter(
        place=place,
        time_ms=time_ms if kind else 0,
        key=record.key(),
        value=value,
        headers=own,
        about=about,
        size_bytes=len(value or b'') if left_out is None else left_out,
    )


def mark(letter: LetterPlace, to: str) -> Outgoing:
    """Make the record that says that a letter was replayed."""
    headers: HeaderList = [
        ('dead_letter.replayed', str(letter.offset)),
        ('dead_letter.to', to),
        ('dead_letter.time_ns', str(time.time_ns())),
    ]
    # A key of its own and a value, so that a compacted topic takes it and keeps it.
    return Outgoing(letter.topic, f'replayed {letter.offset}'.encode(), b'', headers)


def _mark(place: LetterPlace, headers: HeaderList) -> Mark | None:
    if tuple(name for name, _ in headers) != _MARK:
        return None
    replayed, to, time_ns = (_text(value) for _, value in headers)
    offset = _number(replayed)
    if offset is None or offset >= place.offset:
        return None
    return Mark(place._replace(offset=offset), to, _number(time_ns) or 0)


def _block_begins(headers: HeaderList) -> int | None:
    """Where the headers begin that the bridge has added last."""
    for index in range(len(headers) - 1, -1, -1):
        name = headers[index][0]
        if name == 'dead_letter.error':
            return index
        if not name.startswith(PREFIX):
            break
    return None


def _about(block: HeaderList) -> Explanation | None:
    told = {name.removeprefix(PREFIX): _text(value) for name, value in block}
    if len(told) != len(block) or not {'error', 'route', 'topic', 'time_ns'} <= told.keys():
        return None
    partition, offset = _number(told.get('partition', '')), _number(told.get('offset', ''))
    ros_topic = told.get('source', '')
    if (
        not told['topic']
        or max(map(len, (told['topic'], told['route'], ros_topic))) > _LONGEST_NAME
    ):
        return None  # of what a stranger has made up, no megabytes are kept and printed
    if bool(ros_topic) == (partition is not None and offset is not None):
        return None
    return Explanation(
        reason=told['error'],
        route=told['route'],
        topic=told['topic'],
        partition=partition,
        offset=offset,
        ros_topic=ros_topic,
        time_ns=_number(told['time_ns']) or 0,
        value_bytes=_number(told.get('value_bytes', '')),
    )


def _text(value: str | bytes | None) -> str:
    return value if isinstance(value, str) else (value or b'').decode(errors='replace')


def _number(text: str) -> int | None:
    return int(text) if _NUMBER.fullmatch(text) else None
