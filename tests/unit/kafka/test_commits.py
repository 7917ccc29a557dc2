"""What a group is told again, so that no offset of it grows too old."""

import logging
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.kafka import commits as under_test
from ros2_kafka_bridge.kafka.commits import Commits
from ros2_kafka_bridge.kafka.partitions import Partitions
from ros2_kafka_bridge.kafka.topic_id import TopicId

LOG = logging.LoggerAdapter(logging.getLogger('commits'), {})


@pytest.mark.parametrize('how', ['soon', 'within'])
def test_a_broker_that_takes_no_metadata_so_long_gets_the_offsets_alone(how: str) -> None:
    """Those who set offset.metadata.max.bytes to next to nothing."""
    client, partitions = MagicMock(), Partitions()
    partitions.assign([0])
    partitions[0].of = TopicId('cluster', 'topic')
    partitions.advance({0: 7})
    commits = Commits(client, 't', partitions, MagicMock(away=''), LOG)
    refused = KafkaError(KafkaError.OFFSET_METADATA_TOO_LARGE)
    if how == 'soon':
        commits.soon()
        commits.on_answer(refused, [])
    else:
        client.commit.side_effect = [KafkaException(refused), None]
        commits.within(5.0, {0: 7})
        client.commit.side_effect = None
    commits.soon()
    told = [call.kwargs['offsets'][0].metadata for call in client.commit.call_args_list]
    assert told == [partitions[0].of.metadata, *[''] * (len(told) - 1)]
    assert len(told) > 1


def test_the_offset_of_a_quiet_partition_is_committed_again_once_an_hour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a group by KIP-848 it would expire as soon as the last member has left."""
    now_s = [1000.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr(under_test, 'time', clock)
    client, health, partitions = MagicMock(), MagicMock(away=''), Partitions()
    partitions.assign([0, 1])
    partitions.advance({0: 7})
    commits = Commits(client, 't', partitions, health, LOG)

    def committed() -> list[tuple[int, int]]:
        commits.soon()
        told = [it for call in client.commit.call_args_list for it in call.kwargs['offsets']]
        client.commit.reset_mock()
        commits.on_answer(None, told)
        return [(it.partition, it.offset) for it in told]

    assert committed() == [(0, 7)]
    assert committed() == []
    now_s[0] += 3601
    health.away = 'no broker answers'
    assert committed() == []
    partitions.lose({0})
    assert not partitions.owe_lost, 'the group has it all the same'
    partitions.assign([0])
    partitions.advance({0: 7})
    partitions.note_committed({0: 7})
    health.away = ''
    assert committed() == [(0, 7)], 'and nothing of one whose position is not known'
    assert committed() == []
