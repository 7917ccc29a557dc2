"""What librdkafka's statistics tell of a client and of its way to the brokers."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import msgspec

_INTERVAL: Final = 'statistics.interval.ms'
_INTERVAL_MS: Final = 2000
_BEHIND_NAMES: Final = '"type"'
_S_PER_US: Final = 1e-6
_CONNECTED: Final = 'UP'
_BROKERS: Final = frozenset({'configured', 'learned'})  # others are librdkafka's own helpers


class Statistics(NamedTuple):
    """One report of a client.

    Attributes:
        round_trip_s: To the slowest broker that was asked, median and 99th percentile; None
            where none was.
        knows_brokers: Whether there is any broker that it can connect to.
        is_connected: Whether it is to one.
    """

    round_trip_s: tuple[float, float] | None
    knows_brokers: bool
    is_connected: bool


class _Times(msgspec.Struct, frozen=True):
    """Percentiles of one interval, in microseconds."""

    p50: int = 0
    p99: int = 0
    cnt: int = 0


class _Broker(msgspec.Struct, frozen=True):
    source: str = ''
    state: str = ''
    rtt: _Times = _Times()


class _Told(msgspec.Struct, frozen=True):
    brokers: dict[str, _Broker] = {}


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
        brokers = _DECODER.decode(f'{{{text[rest:]}' if rest else text).brokers.values()
    except msgspec.DecodeError:
        return Statistics(None, knows_brokers=True, is_connected=False)
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
        any(broker.state == _CONNECTED for broker in brokers),
    )
