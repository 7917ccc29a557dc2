"""How old a record is, by the time that its writer or the broker gave it (`max_age_s`)."""

import time
from typing import Final

from ros2_kafka_bridge.errors import RouteError, TimestampError
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.route import clock

_NO_TIMESTAMP: Final = 0
_AHEAD_MS: Final = 5 * 60 * 1000
_FIRST_MS: Final = 10**12  # 2001, ten years before Kafka: what is less are seconds, or no time
_WHOSE: Final = (
    'so max_age_s cannot tell how old it is: the clock of its writer is wrong, or its unit (it is '
    "milliseconds since 1970), or this machine's clock"
)
_UNITS: Final = (('year', 31_557_600_000), ('day', 86_400_000), ('hour', 3_600_000))


def expires_s(timestamp: tuple[int, int], max_age_s: float) -> float:
    """When a record becomes too old, by the clock since boot, which nobody sets while it waits.

    Args:
        timestamp: Of the record: its kind, and milliseconds since 1970.
        max_age_s: Of the route.

    Raises:
        TimestampError: That cannot be the time of a record.
        RouteError: This machine does not know what time it is.
    """
    kind, made_ms = timestamp
    if kind == _NO_TIMESTAMP:
        return float('inf')
    if problem := clock.problem():
        raise RouteError(f'max_age_s: {problem}')
    age_ms = time.time() * 1000 - made_ms
    if age_ms < -_AHEAD_MS:
        raise TimestampError(
            f"its timestamp is {_roughly(-age_ms)} ahead of this machine's clock, {_WHOSE}"
        )
    if made_ms < _FIRST_MS:
        raise TimestampError(f'its timestamp lies before 2001, {_WHOSE}')
    return clock.since_boot_s() + max_age_s - age_ms / 1000


def _roughly(span_ms: float) -> str:
    """A span in words that many records share."""
    for unit, length_ms in _UNITS:
        if span_ms >= length_ms:
            return f'more than {count(int(span_ms // length_ms), unit)}'
    return 'more than 5 minutes'
