"""What librdkafka's statistics tell of a client and of its way to the brokers."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import msgspec

_INTERVAL: Final = 'statistics.interval.ms'
_INTERVAL_MS: Final = 4000
_BEHIND_NAMES: Final = '"type"'
_S_PER_US: Final = 1e-6
_CONNECTED: Final = 'UP'
_NO_ID: Final = -1
_FETCHED: Final = 'active'
_COORDINATOR: Final = 'logical'  # one of them, under another name
_BROKERS: Final = frozenset({'configured', 'learned'})  # others are librdkafka's own helpers


class PartitionEnds(NamedTuple):
    """Where a partition ended at the last fetch; offsets.

    Attributes:
        stable: Of the first record of a transaction without an end, or as `high`.
        high: Behind the last record.
        is_led: Whether the broker that leads the partition is there.
    """

    stable: int
    high: int
    is_led: bool = True

    @property
    def is_open(self) -> bool:
        """Whether a transaction there has no end."""
        return 0 <= self.stable < self.high


class Statistics(NamedTuple):
    """One report of a client.

    Attributes:
        round_trip_s: To the slowest broker that was asked, median and 99th percentile; None
            where none was.
        knows_brokers: Whether there is any broker that it can connect to.
        is_connected: Whether it is to one of the cluster: what answers at bootstrap.servers may
            name brokers that do not.
        ends: Where the partitions of its topic end, those that it fetches.
        metadata_age_s: How long ago it was told of its topic; None where it never was.
    """

    round_trip_s: tuple[float, float] | None
    knows_brokers: bool
    is_connected: bool
    ends: Mapping[int, PartitionEnds] = MappingProxyType({})
    metadata_age_s: float | None = None


class _Times(msgspec.Struct, frozen=True):
    """Percentiles of one interval, in microseconds."""

    p50: int = 0
    p99: int = 0
    cnt: int = 0


class _Broker(msgspec.Struct, frozen=True):
    nodeid: int = _NO_ID
    source: str = ''
    state: str = ''
    rtt: _Times = _Times()

    @property
    def is_up(self) -> bool:
        """Whether it is a broker that the cluster has named, and there."""
        return self.state == _CONNECTED and (self.nodeid >= 0 or self.source == _COORDINATOR)


class _Partition(msgspec.Struct, frozen=True):
    leader: int = _NO_ID
    fetch_state: str = ''
    ls_offset: int = -1
    hi_offset: int = -1


class _Topic(msgspec.Struct, frozen=True):
    metadata_age: int = 0  # in milliseconds; 0 before there was any
    partitions: dict[int, _Partition] = {}


class _Told(msgspec.Struct, frozen=True):
    brokers: dict[str, _Broker] = {}
    topics: dict[str, _Topic] = {}


_DECODER: Final = msgspec.json.Decoder(_Told)


def with_statistics(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Properties of a client that tells its statistics, often enough to know whether it lives."""
    wanted_ms = int(properties.get(_INTERVAL, 0)) or _INTERVAL_MS
    return {**properties, _INTERVAL: min(wanted_ms, _INTERVAL_MS)}


def read(text: str) -> Statistics:
    """Read what librdkafka calls back with (its STATISTICS.md)."""
    # It begins with the client.id, whose quotes librdkafka does not escape.
    rest = max(0, text.find(_BEHIND_NAMES))
    try:
        told = _DECODER.decode(f'{{{text[rest:]}' if rest else text)
    except msgspec.DecodeError:
        return Statistics(None, knows_brokers=True, is_connected=False)
    brokers = told.brokers.values()
    asked = [broker.rtt for broker in brokers if broker.rtt.cnt]
    round_trip_s = None
    if asked:
        round_trip_s = (
            _S_PER_US * max(times.p50 for times in asked),
            _S_PER_US * max(times.p99 for times in asked),
        )
    return Statistics(
        round_trip_s,
        any(broker.source in _BROKERS for broker in brokers),
        any(broker.is_up for broker in brokers),
        _ends(told),
        min(
            (topic.metadata_age / 1000 for topic in told.topics.values() if topic.metadata_age),
            default=None,
        ),
    )


def _ends(told: _Told) -> dict[int, PartitionEnds]:
    # The coordinator goes by another name and no id, as a partition without a leader has none.
    up = {broker.nodeid for broker in told.brokers.values() if broker.is_up} - {_NO_ID}
    return {
        number: PartitionEnds(it.ls_offset, it.hi_offset, it.leader in up)
        for topic in told.topics.values()
        for number, it in topic.partitions.items()
        if it.fetch_state == _FETCHED
    }
