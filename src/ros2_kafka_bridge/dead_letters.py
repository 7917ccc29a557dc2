"""Records that can never be delivered, kept in a dead-letter topic with the reason."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple

from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, RecordSink, Token
from ros2_kafka_bridge.errors import RecordError, RecordTooLargeError, RouteError, TransportError

_REASON_CHARS = 1000


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


def explain(record: Outgoing, error: RecordError, origin: Origin) -> Outgoing:
    """Add to a record why it is a dead letter."""
    reason: HeaderList = [
        ('dead_letter.error', f'{type(error).__name__}: {error}'[:_REASON_CHARS]),
        ('dead_letter.route', origin.route),
        *origin.place,
        ('dead_letter.time_ns', str(time.time_ns())),
    ]
    return record._replace(headers=[*record.headers, *reason])


def without_value(record: Outgoing) -> Outgoing:
    """Leave the value out, and say how long it was."""
    size: HeaderList = [('dead_letter.value_bytes', str(len(record.value or b'')))]
    return record._replace(value=None, headers=[*record.headers, *size])


def _bare(record: Outgoing) -> Outgoing:
    own = [header for header in record.headers if header[0].startswith('dead_letter.')]
    return record._replace(key=None, headers=own)


class Letter(NamedTuple, Generic[Token]):
    """A dead letter on its way; `smaller` are the ways left to make it fit."""

    token: Token
    record: Outgoing
    smaller: Sequence[Callable[[Outgoing], Outgoing]]


class DeadLetters(Generic[Token]):
    """The way to one dead-letter topic; opened when the first letter is written.

    Args:
        topic: The dead-letter topic.
        sink: Where its records are produced, not open yet.
        ensure_topic: Creates the topic if it may be.
    """

    def __init__(
        self, topic: str, sink: RecordSink[Letter[Token]], ensure_topic: Callable[[], None]
    ) -> None:
        self.topic = topic
        self._sink = sink
        self._ensure_topic = ensure_topic
        self._open = False
        self._waiting: deque[Letter[Token]] = deque()

    def add(self, record: Outgoing, token: Token) -> None:
        """Write a record, explained already; `poll` returns the token once it is confirmed."""
        if not self._open:
            self._sink.open()
            self._open = True
            self._ensure_topic()
        smaller = (_bare,) if record.value is None else (without_value, _bare)
        self._waiting.append(Letter(token, record._replace(topic=self.topic), smaller))

    def poll(self, timeout_s: float = 0.0) -> Sequence[Token]:
        """Send what waits and return the tokens of the letters that are confirmed.

        Raises:
            RouteError: The dead-letter topic cannot be written.
        """
        if not self._open:
            return ()
        while self._waiting and self._send(self._waiting[0]):
            self._waiting.popleft()
        reports = self._sink.poll(timeout_s)
        for letter, error in reports.failed:
            self._again(letter, error)
        return [letter.token for letter in reports.confirmed]

    def close(self) -> Sequence[Token]:
        """Give up what is not written; return the tokens that were confirmed meanwhile."""
        if not self._open:
            return ()
        self._open = False
        self._waiting.clear()
        return [letter.token for letter in self._sink.close()]

    def _send(self, letter: Letter[Token]) -> bool:
        try:
            return self._sink.produce(letter.record, letter)
        except RecordTooLargeError as error:
            self._again(letter, error)
            return True

    def _again(self, letter: Letter[Token], error: Exception) -> None:
        if isinstance(error, RecordTooLargeError) and letter.smaller:
            shrink, *rest = letter.smaller
            self._waiting.append(Letter(letter.token, shrink(letter.record), rest))
        elif isinstance(error, TransportError):
            self._waiting.append(letter)
        else:
            raise RouteError(f'cannot write to the dead-letter topic {self.topic}: {error}')
