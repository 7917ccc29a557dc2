"""The pipeline ROS -> Kafka with ends in memory, driven step by step."""

import logging
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

from support.worlds.flights import TO_KAFKA, Driven

from ros2_kafka_bridge.config.settings import RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.errors import EncodeError
from ros2_kafka_bridge.formats import guarded
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.identity import Identity
from ros2_kafka_bridge.route.labels import Conversion
from ros2_kafka_bridge.route.type_hash import check_nothing
from ros2_kafka_bridge.testing.memory import MemoryMessageSource, MemoryRecordSink

if TYPE_CHECKING:
    from ros2_kafka_bridge.route.flight.messages import MessageEntry
    from ros2_kafka_bridge.route.produced import Produced


LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


def encode(cdr: bytes) -> bytes:
    if cdr.startswith(b'bad'):
        raise EncodeError('not what it should be')
    if cdr.startswith(b'bug'):
        raise AttributeError("'NoneType' object has no attribute 'get'")
    return cdr


class InKafka:
    """Kafka holds the messages and the dead letters of these numbers, whoever published them."""

    unproved = 0

    def __init__(self, numbers: frozenset[int], letters: frozenset[int]) -> None:
        self.numbers = set(numbers)
        self.letters = letters

    def not_there(self, messages: Sequence[Message]) -> Iterable[Message]:
        return (message for message in messages if message.seq not in self.numbers)

    def add(self, numbers: Iterable[tuple[bytes, int]]) -> None:
        self.numbers |= {seq for _, seq in numbers}

    def look_at_end(self) -> None:
        pass

    def holds(self, _identity: Identity) -> bool:
        return False

    def holds_letter(self, identity: Identity) -> bool:
        return identity.seq in self.letters


class House(Driven):
    """A pipeline with its ends."""

    def __init__(
        self,
        seen: frozenset[int] = frozenset(),
        refused: frozenset[int] = frozenset(),
        sink: 'MemoryRecordSink[MessageEntry] | None' = None,
        **settings: Any,
    ) -> None:
        self.source = MemoryMessageSource()
        self.sink: MemoryRecordSink[MessageEntry] = sink or MemoryRecordSink()
        self.letters: MemoryRecordSink[Any] = MemoryRecordSink()
        route = validated(RosToKafkaRoute, {'name': 'orders', **TO_KAFKA, **settings})
        dead: DeadLetters[MessageEntry] = DeadLetters(
            'orders.dead', self.letters, lambda: None, LOG
        )
        self.pipeline: RosToKafka = RosToKafka(
            route,
            self.source,
            cast('Produced', InKafka(seen, refused)),
            self.sink,
            Conversion(
                lambda: guarded(encode, route.max_message_bytes, EncodeError),
                lambda _: b'key',
                lambda message: [('ros.seq', str(message.seq))],
                check_nothing,
            ),
            dead,
            None,
            LOG,
        )
        self.pause = self.pipeline._pause
        self.pipeline._prepare()
        self.sink.open()

    def give(self, *cdr: bytes, first: int = 1) -> None:
        for number, one in enumerate(cdr):
            self.source.waiting.append(Message(one, b'gid', first + number, 0))

    def values(self) -> list[bytes | None]:
        return [record.value for record in self.sink.records]

    def count(self, name: str) -> int:
        return int(getattr(self.pipeline.counters.snapshot(0), name))
