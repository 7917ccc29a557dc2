"""What a group is told, and told again so that no offset of it grows too old."""

import logging
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka import offsets as under_test
from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.topic_id import TopicId

LOG = logging.LoggerAdapter(logging.getLogger('offsets'), {})


def opened(monkeypatch: pytest.MonkeyPatch, library: MagicMock, *numbers: int) -> Offsets:
    """Offsets of these partitions, committed by a client that stands on that library."""
    monkeypatch.setattr(group_client, 'Consumer', lambda *_, **__: library)
    client = GroupClient({}, 't', MagicMock(away=''), LOG.logger)
    client.open()
    offsets = Offsets('t', LOG)
    offsets.use(client)
    offsets.assign(numbers)
    return offsets


@pytest.mark.parametrize('how', ['commit', 'commit_within'])
def test_a_broker_that_takes_no_metadata_so_long_gets_the_offsets_alone(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those who set offset.metadata.max.bytes to next to nothing."""
    client = MagicMock()
    offsets = opened(monkeypatch, client, 0)
    offsets[0].of = TopicId('cluster', 'topic')
    offsets.advance({0: 7})
    refused = KafkaError(KafkaError.OFFSET_METADATA_TOO_LARGE)
    if how == 'commit':
        offsets.commit()
        offsets.on_answer(refused, [])
    else:
        client.commit.side_effect = [KafkaException(refused), None]
        offsets.commit_within(5.0, {0: 7})
        client.commit.side_effect = None
    offsets.commit()
    told = [call.kwargs['offsets'][0].metadata for call in client.commit.call_args_list]
    assert told == [offsets[0].of.metadata, *[''] * (len(told) - 1)]
    assert len(told) > 1


def test_the_offset_of_a_quiet_partition_is_committed_again_once_an_hour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a group by KIP-848 it would expire as soon as the last member has left."""
    now_s = [1000.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr(under_test, 'time', clock)
    client = MagicMock()
    offsets = opened(monkeypatch, client, 0, 1)
    offsets.advance({0: 7})
    health = offsets._client.health

    def committed() -> list[tuple[int, int]]:
        offsets.commit()
        told = [it for call in client.commit.call_args_list for it in call.kwargs['offsets']]
        client.commit.reset_mock()
        offsets.on_answer(None, told)
        return [(it.partition, it.offset) for it in told]

    assert committed() == [(0, 7)]
    assert committed() == []
    now_s[0] += 3601
    health.away = 'no broker answers'
    assert committed() == []
    offsets.lose({0})
    assert not offsets.owe_lost, 'the group has it all the same'
    offsets.assign([0])
    offsets.advance({0: 7})
    offsets.note_committed({0: 7})
    health.away = ''
    assert committed() == [(0, 7)], 'and nothing of one whose position is not known'
    assert committed() == []
