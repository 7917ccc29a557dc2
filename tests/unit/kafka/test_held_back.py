"""What Kafka does not give out is said: an open transaction, a quota; and the lag counts it."""

import json
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.kafka import consumer
from ros2_kafka_bridge.kafka import held_back as under_test
from ros2_kafka_bridge.kafka.consumer import Lag
from ros2_kafka_bridge.kafka.held_back import HeldBack
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.statistics import PartitionEnds, read

OPEN = PartitionEnds(stable=10, high=160)
ACTIVE = {'fetch_state': 'active'}


@pytest.fixture
def clock_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now_s = [1000.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr(under_test, 'time', clock)
    return now_s


@pytest.fixture
def offsets() -> Offsets:
    made = Offsets('orders', MagicMock())
    made.assign([0, 1])
    made.reach_end(0, 10)
    return made


def test_an_open_transaction_is_said_with_its_place_once_it_lasts_and_the_cure_once_it_hangs(
    offsets: Offsets, clock_s: list[float]
) -> None:
    """A job that commits at its checkpoints is well: nobody is to abort what it writes."""
    held = HeldBack(offsets)
    held.on_ends({0: OPEN, 1: PartitionEnds(7, 7)})
    clock_s[0] += 9
    held.on_ends({0: OPEN})
    assert held.reason == ''
    clock_s[0] += 2
    said = held.reason
    assert said.startswith(
        'orders[0]: waits from offset 10 on for the end of a transaction, seen open'
    )
    assert 'abort' not in said
    clock_s[0] += 960
    held.on_ends({0: OPEN._replace(high=500)})
    assert 'its producer hangs: end that, or abort the transaction' in held.reason
    held.on_ends({0: PartitionEnds(500, 500)})
    assert held.reason == ''


def test_a_transaction_that_is_not_reached_yet_or_another_is_no_reason(
    offsets: Offsets, clock_s: list[float]
) -> None:
    held = HeldBack(offsets)
    held.on_ends({0: PartitionEnds(90, 160), 1: OPEN, 7: OPEN})
    clock_s[0] += 60
    assert held.reason == '', 'there is more to read before it; and what is not ours'
    offsets.reach_end(0, 90)
    held.on_ends({0: PartitionEnds(120, 160)})
    assert held.reason == '', 'another transaction began just now'


def test_a_quota_that_stops_the_client_is_said_and_one_that_slows_it_is_not(
    offsets: Offsets, clock_s: list[float]
) -> None:
    held = HeldBack(offsets)
    held.on_throttle(0.3)
    assert not held.is_throttled
    held.on_throttle(30.008)
    assert (held.is_throttled, held.hides_ends) == (True, True)
    assert 'consumer_byte_rate' in held.reason
    held.on_throttle(0.0)
    clock_s[0] += 30
    assert held.is_throttled, 'the next answer tells whether it goes on'
    clock_s[0] += 6
    assert (held.is_throttled, held.reason) == (False, '')


def test_the_ends_are_read_out_of_the_report_of_the_client() -> None:
    """As librdkafka 2.16 tells them of a topic with a transaction left open."""
    told = {
        'topics': {
            'orders': {
                'topic': 'orders',
                'partitions': {
                    '0': {'leader': 1, **ACTIVE, 'hi_offset': 160, 'ls_offset': 10},
                    '1': {'leader': 2, **ACTIVE, 'hi_offset': -1001, 'ls_offset': -1001},
                    '2': {'leader': 1, 'fetch_state': 'stopped', 'hi_offset': 9, 'ls_offset': 3},
                    '3': {'leader': -1, **ACTIVE, 'hi_offset': 7, 'ls_offset': 7},
                    '-1': {'leader': -1, 'fetch_state': 'none', 'hi_offset': -1001},
                },
            }
        },
        'brokers': {
            'a:1/1': {'nodeid': 1, 'source': 'learned', 'state': 'UP'},
            'b:1/2': {'nodeid': 2, 'source': 'learned', 'state': 'TRY_CONNECT'},
            'GroupCoordinator': {'nodeid': -1, 'source': 'logical', 'state': 'UP'},
        },
    }
    ends = read(json.dumps({'name': 'a', 'type': 'consumer', **told})).ends
    nobody = PartitionEnds(7, 7, is_led=False)
    assert ends == {0: OPEN, 1: PartitionEnds(-1001, -1001, is_led=False), 3: nobody}
    assert [number for number, end in ends.items() if end.is_open] == [0]


def test_a_leader_that_is_away_is_said_and_where_its_partition_ends_is_not_known(
    offsets: Offsets, clock_s: list[float]
) -> None:
    """While the other brokers go on: Kafka is not away, and this partition is not read."""
    held = HeldBack(offsets)
    held.on_ends({0: PartitionEnds(10, 10), 1: PartitionEnds(-1001, -1001, is_led=False)})
    assert (held.hides_ends, held.reason) == (True, '')
    clock_s[0] += 11
    assert held.reason.startswith('orders[1]: the broker that leads it does not answer, since ')
    held.on_ends({0: PartitionEnds(10, 10), 1: PartitionEnds(3, 3)})
    assert (held.hides_ends, held.reason) == (False, '')


def client(**ends: int) -> Any:
    """A client that was told where partitions end, or not (-1001)."""
    made = MagicMock()
    made.get_watermark_offsets.side_effect = lambda place, **_: (0, ends[f'p{place.partition}'])
    return made


@pytest.mark.parametrize(
    ('ends', 'expected'),
    [
        ({'p0': 160, 'p1': 4}, 150 + 1),
        ({'p0': 10, 'p1': 3}, 0),
        ({'p0': 160, 'p1': -1001}, None),
        ({'p0': -1001, 'p1': -1001}, None),
    ],
)
def test_the_lag_counts_what_is_held_back_and_is_not_known_where_an_end_is_not(
    offsets: Offsets, ends: dict[str, int], expected: int | None
) -> None:
    offsets.reach_end(1, 3)
    assert Lag(offsets).count(client(**ends), ask=False) == expected


def test_how_far_was_read_is_asked_for_where_a_backlog_hides_it_and_not_known_before(
    offsets: Offsets, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While other partitions are read on: records of this one come late."""
    now_s = [1000.0]
    monkeypatch.setattr(consumer, 'time', SimpleNamespace(monotonic=lambda: now_s[0]))
    counts, broker = Lag(offsets), client(p0=10, p1=50)
    broker.committed.return_value = [MagicMock(partition=1, offset=20)]
    assert counts.count(broker, ask=False) is None
    broker.committed.assert_not_called()
    now_s[0] += 3
    assert counts.count(broker, ask=False) == 30
    assert all(call.kwargs.get('cached') for call in broker.get_watermark_offsets.call_args_list)
    now_s[0] += 60
    assert counts.count(broker, ask=False) == 30
    broker.committed.assert_called_once()
