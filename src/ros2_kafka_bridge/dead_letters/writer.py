"""Records that can never be delivered, kept in a dead-letter topic with the reason."""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Generic, NamedTuple

from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, RecordSink, Token
from ros2_kafka_bridge.errors import (
    REASON_CHARS,
    BridgeError,
    RecordError,
    RecordTooLargeError,
    TransportError,
)
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.threads.backoff import Backoff

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


def _bare(record: Outgoing) -> Outgoing:
    """Leave out all but the reason; headers that look like it may have come with the record."""
    names = [name for name, _ in record.headers]
    begin = len(names) - 1 - names[::-1].index(_FIRST)
    return record._replace(key=None, headers=record.headers[begin:])


class OutgoingLetter(NamedTuple, Generic[Token]):
    """A dead letter on its way; `smaller` are the ways left to make it fit."""

    token: Token
    record: Outgoing
    smaller: Sequence[Callable[[Outgoing], Outgoing]]


class DeadLetters(Generic[Token]):
    """The way to one dead-letter topic; opened when the first letter is written.

    A topic that cannot be written is tried again with backoff, and `problem` says why: the
    pipeline stops reading meanwhile, and nothing is lost or repeated for it.

    Args:
        topic: The dead-letter topic.
        sink: Where its records are produced, not open yet.
        ensure_topic: Creates the topic if it may be.
        log: Where to say what happens.
    """

    def __init__(
        self,
        topic: str,
        sink: RecordSink[OutgoingLetter[Token]],
        ensure_topic: Callable[[], None],
        log: logging.LoggerAdapter[logging.Logger],
    ) -> None:
        self.topic = topic
        self.problem = ''
        self._sink = sink
        self._ensure_topic = ensure_topic
        self._log = log
        self._open = False
        self._waiting: deque[OutgoingLetter[Token]] = deque()
        self._sent: dict[int, OutgoingLetter[Token]] = {}
        self._delivered: list[Token] = []
        self._again_at_s = 0.0
        self._backoff = Backoff()
        self._error: BridgeError | None = None  # that nobody was told of

    def take_error(self) -> BridgeError | None:
        """Return why the topic could not be written, once for each time."""
        error, self._error = self._error, None
        return error

    def add(self, record: Outgoing, token: Token) -> None:
        """Take a record, explained already; `poll` returns the token once it is confirmed."""
        smaller = (_bare,) if record.value is None else (without_value, _bare)
        self._waiting.append(OutgoingLetter(token, record._replace(topic=self.topic), smaller))

    def poll(self) -> Sequence[Token]:
        """Send what waits, and return the tokens of the letters that were confirmed."""
        if (self._waiting or self._sent) and time.monotonic() >= self._again_at_s:
            try:
                self._deliver()
            except BridgeError as error:
                self._fail(error)
        elif self._open:  # a client that nobody polls keeps all it has to tell
            with suppress(BridgeError):
                self._sink.poll(0.0)
        delivered, self._delivered = self._delivered, []
        return delivered

    def close(self) -> Sequence[Token]:
        """Give up what is not written; return the tokens that were confirmed meanwhile."""
        self._close_sink()
        self._waiting.clear()
        self._sent.clear()
        self.problem = ''
        delivered, self._delivered = self._delivered, []
        return delivered

    def _deliver(self) -> None:
        if not self._open:
            self._sink.open()
            self._open = True
            self._ensure_topic()
        while self._waiting and self._send(self._waiting[0]):
            self._waiting.popleft()
        reports = self._sink.poll(0.0)
        self._end(reports.confirmed)
        if reports.confirmed:
            self.problem = ''
            self._backoff = Backoff()
        problems = [self._send_again(letter, error) for letter, error in reports.failed]
        for problem in filter(None, problems):
            raise problem

    def _end(self, letters: Iterable[OutgoingLetter[Token]]) -> None:
        for letter in letters:
            del self._sent[id(letter)]
            self._delivered.append(letter.token)

    def _send(self, letter: OutgoingLetter[Token]) -> bool:
        try:
            taken = self._sink.produce(letter.record, letter)
        except RecordTooLargeError as error:
            self._sent[id(letter)] = letter
            if problem := self._send_again(letter, error):
                raise problem from error
            return True
        if taken:
            self._sent[id(letter)] = letter
        return taken

    def _send_again(self, letter: OutgoingLetter[Token], error: BridgeError) -> BridgeError | None:
        """Put a letter back in line, smaller where that helps; return what only a person mends."""
        del self._sent[id(letter)]
        if isinstance(error, RecordTooLargeError) and letter.smaller:
            shrink, *rest = letter.smaller
            self._waiting.append(OutgoingLetter(letter.token, shrink(letter.record), rest))
            return None
        self._waiting.append(letter)
        return None if isinstance(error, TransportError) else error

    def _fail(self, error: BridgeError) -> None:
        self.problem = f'the dead-letter topic {self.topic} cannot be written: {error}'
        self._error = error
        self._backoff = self._backoff.after()
        self._again_at_s = time.monotonic() + self._backoff.wait_s
        self._log.error('failed: %s; tried again in %.0f s', self.problem, self._backoff.wait_s)
        self._close_sink()
        self._waiting.extendleft(reversed(self._sent.values()))
        self._sent.clear()

    def _close_sink(self) -> None:
        if self._open:
            self._open = False
            self._end(self._sink.close())
