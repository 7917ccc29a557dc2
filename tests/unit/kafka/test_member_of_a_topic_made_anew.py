"""What a member of a group does with its partitions where their topic was made anew."""

import logging
from collections.abc import Callable
from typing import Any
from unittest.mock import MagicMock, call

import pytest
from confluent_kafka import (
    OFFSET_BEGINNING,
    OFFSET_INVALID,
    KafkaError,
    KafkaException,
    TopicPartition,
)
from support.kafka.source_stubs import NEW, OLD, ToldIds

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.topic_id import TopicId
from ros2_kafka_bridge.testing.memory import MemoryRecord

LOG = logging.LoggerAdapter(logging.getLogger('member'), {})


class _Record(MemoryRecord):
    def error(self) -> None:
        pass


class House:
    """A source whose clients are all one mock, with what its route is told."""

    def __init__(self, *ids: TopicId | None) -> None:
        self.ids = ToldIds(*ids)
        self.client = MagicMock()
        self.client.poll.return_value = None
        self.client.get_watermark_offsets.return_value = (0, 50)
        self.client.list_topics.return_value.topics = {'t': MagicMock(error=None, partitions=[0])}
        self.clients: list[MagicMock] = []
        self.route = MagicMock()
        self.source = KafkaSource({'group.id': 'g'}, 't', 'latest', self.ids, LOG)

    def next_client(self) -> Any:
        """What the library makes: one that can be told from the one before."""
        client = MagicMock(wraps=self.client)
        client.poll.side_effect = self.client.poll
        self.clients.append(client)
        return client

    def assign(self, *committed: TopicPartition) -> None:
        """Let the group give the partitions that it has these offsets of."""
        self.client.committed.return_value = list(committed)
        places = [TopicPartition('t', place.partition) for place in committed]
        self.clients[-1].subscribe.call_args.kwargs['on_assign'](self.clients[-1], places)

    @property
    def assigned(self) -> dict[int, int]:
        """Where the last assignment begins, as far as that is not the group's to say."""
        calls = self.client.incremental_assign.call_args_list
        return {place.partition: place.offset for place in (calls[-1].args[0] if calls else ())}

    def committed(self) -> list[tuple[int, int, TopicId | None]]:
        """All that was committed."""
        calls = self.client.commit.call_args_list
        return [
            (place.partition, place.offset, TopicId.of_metadata(place.metadata))
            for made in calls
            for place in made.kwargs['offsets']
        ]


Make = Callable[..., House]
"""Makes a house, with the ids that its topic has in turn."""


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch) -> Make:
    def make(*ids: TopicId | None) -> House:
        made = House(*ids)
        monkeypatch.setattr(group_client, 'Consumer', lambda *_, **__: made.next_client())
        made.source.open(made.route)
        return made

    return make


def stored(offset: int, of: TopicId | None, partition: int = 0) -> TopicPartition:
    return TopicPartition('t', partition, offset, of.metadata if of else '')


def told(code: int, offset: int, partition: int = 0) -> MagicMock:
    message = MagicMock()
    message.error.return_value = KafkaError(code)
    message.partition.return_value, message.offset.return_value = partition, offset
    return message


def test_offsets_of_a_topic_that_is_gone_are_not_begun_at(house: Make) -> None:
    h = house(NEW)
    h.assign(stored(20, OLD), stored(7, NEW, 1), stored(9, None, 2))
    assert {0: OFFSET_BEGINNING}.items() <= h.assigned.items()
    assert h.assigned[1] == h.assigned[2] == OFFSET_INVALID


def test_what_was_lost_of_a_topic_that_is_gone_is_not_gone_on_with(house: Make) -> None:
    """Its client was given up meanwhile, and nobody had read on."""
    h = house(OLD, NEW)
    h.assign(stored(20, OLD))
    h.client.poll.return_value = _Record(b'', 29)
    h.source.poll(1, 0.0)
    h.source.advance({0: 30})
    h.source._member._replace_useless_client(BROKERS_LOST)
    h.assign(stored(20, OLD))
    assert h.assigned == {0: OFFSET_BEGINNING}
    assert h.source._offsets.positions == {}
    assert not h.committed()


def test_what_was_lost_is_gone_on_with_also_where_the_group_says_of_no_topic(house: Make) -> None:
    """As at the first start after an upgrade."""
    h = house(OLD)
    h.assign(stored(20, None))
    h.client.poll.return_value = _Record(b'', 29)
    h.source.poll(1, 0.0)
    h.source.advance({0: 30})
    h.source._member._replace_useless_client(BROKERS_LOST)
    h.assign(stored(20, None))
    assert h.assigned == {0: 30}
    assert h.committed() == [(0, 30, OLD)]


def test_a_topic_made_anew_takes_another_client_and_is_begun_at_0(house: Make) -> None:
    h = house(OLD, NEW)
    h.assign(stored(20, OLD), stored(5, OLD, 1))
    h.source._member._watch.on_metadata(0.0)
    assert h.source.poll(10, 0.0) == ()
    assert len(h.clients) == 2
    assert h.route.mock_calls == [call.detached(frozenset({0, 1}))]
    assert sorted(h.committed(), key=lambda it: it[0]) == [(0, 0, NEW), (1, 0, NEW)]
    h.assign(stored(0, NEW), stored(0, NEW, 1))
    h.source.poll(10, 0.0)
    assert len(h.clients) == 2


def test_a_stop_tells_the_group_to_begin_at_0_of_a_topic_made_anew(house: Make) -> None:
    h = house(OLD, NEW)
    h.assign(stored(20, OLD))
    assert h.source.commit_now(1.0)
    assert h.committed() == [(0, 0, NEW)]
    assert len(h.clients) == 1
    assert h.route.mock_calls == [call.detached(frozenset({0}))]


def test_nothing_of_a_batch_counts_once_its_client_has_left(house: Make) -> None:
    h = house(OLD, NEW)
    h.assign(stored(20, OLD), stored(5, OLD, 1))
    h.client.poll.return_value = _Record(b'', 5, 1)
    h.client.consume.return_value = [
        told(KafkaError._AUTO_OFFSET_RESET, 20),
        told(KafkaError.UNKNOWN_TOPIC_OR_PART, 5, 1),
        _Record(b'', 6, 1),
    ]
    assert h.source.poll(10, 0.0) == []
    assert len(h.clients) == 2
    h.client.poll.return_value = None
    h.source.poll(10, 0.0)  # what the old client said fails nothing


def test_offsets_that_cannot_be_asked_for_end_the_run(house: Make) -> None:
    """Of which topic they are is not known: the next run asks again."""
    h = house(NEW)
    h.client.committed.side_effect = KafkaException(KafkaError(KafkaError._TIMED_OUT))
    h.assign(stored(20, OLD))
    with pytest.raises(BridgeError, match='the offsets of its group cannot be read'):
        h.source.poll(10, 0.0)


def test_a_partition_whose_offsets_went_with_its_topic_is_committed_as_it_begins_anew(
    house: Make,
) -> None:
    """Without an offset, the next life would begin where `start` says, and pass over the rest."""
    h = house(NEW, NEW)
    h.assign(stored(20, NEW))
    h.client.poll.return_value = _Record(b'', 20)
    h.source.poll(1, 0.0)
    h.source.advance({0: 21})
    h.client.committed.return_value = [stored(OFFSET_INVALID, None)]
    h.client.get_watermark_offsets.return_value = (0, 5)
    h.client.poll.return_value = told(KafkaError._AUTO_OFFSET_RESET, 21)
    h.source.poll(1, 0.0)
    assert h.assigned == {0: 0}
    assert h.committed() == [(0, 0, NEW)]
