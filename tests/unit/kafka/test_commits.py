"""What a group is told again, so that no offset of it grows too old."""

import logging
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.kafka import commits as under_test
from ros2_kafka_bridge.kafka.commits import Commits
from ros2_kafka_bridge.kafka.partitions import Partitions


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
    log = logging.LoggerAdapter(logging.getLogger('commits'), {})
    commits = Commits(client, 't', partitions, health, log)

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
