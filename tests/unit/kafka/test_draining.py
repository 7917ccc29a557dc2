"""A client is told what waits for it, whatever it raises meanwhile."""

from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.kafka import group_client
from ros2_kafka_bridge.kafka.group_client import drain

USELESS = KafkaException(KafkaError(KafkaError._INVALID_ARG))


def test_it_goes_on_until_nothing_comes_and_no_partition_is_left() -> None:
    client = MagicMock()
    client.poll.side_effect = ['a record', USELESS, SystemError(), None, 'a record', None]
    client.assignment.side_effect = [['orders'], []]
    drain(client, 60, has_left=True)
    assert client.poll.call_count == 6


def test_who_stays_a_member_keeps_its_partitions() -> None:
    client = MagicMock()
    client.poll.side_effect = ['a record', None]
    client.assignment.return_value = ['orders']
    drain(client, 60, has_left=False)
    assert client.poll.call_count == 2


@pytest.mark.parametrize('comes', ['a record', None])
def test_it_ends_in_time(comes: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = MagicMock(monotonic=MagicMock(side_effect=range(100)))
    monkeypatch.setattr(group_client, 'time', clock)
    client = MagicMock()
    client.poll.return_value = comes
    client.assignment.return_value = ['orders']
    drain(client, 10, has_left=True)
    assert client.poll.call_count == 9
