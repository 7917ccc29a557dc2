"""What it costs that a route measures itself, in microseconds for each message on one core.

    python -m benchmarks.measuring

A route measures each batch of its loop as a whole, so it depends on how many are in one. The
lowest of several runs counts: whatever else the machine does makes a run longer only.
"""

import time
import timeit
from collections.abc import Callable
from functools import partial
from typing import Final

from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.route.flight.messages import MessageEntry
from ros2_kafka_bridge.route.flight.records import RecordEntry
from ros2_kafka_bridge.route.measuring import Meter
from ros2_kafka_bridge.testing.memory import MemoryRecord

_BATCHES: Final = (1, 10, 100, 500)
_CALLS: Final = 200
_RUNS: Final = 30
_SPREAD_S: Final = 1e-4  # from one message of a batch to the next


def main() -> None:
    """Print a line for each direction and size of a batch."""
    for size in _BATCHES:
        records, messages = [*map(_record, range(size))], [*map(_message, range(size))]
        meter = Meter()
        _say('Kafka -> ROS: published', size, partial(meter.publish_records, records))
        _say('Kafka -> ROS: confirmed', size, partial(meter.confirm_records, records))
        _say('ROS -> Kafka: confirmed', size, partial(meter.confirm_messages, messages))


def _record(number: int) -> RecordEntry:
    entry = RecordEntry(MemoryRecord(b'x'), time.monotonic() - number * _SPREAD_S)
    entry.made_ms = int(1000 * (time.time() - number * _SPREAD_S))
    return entry


def _message(number: int) -> MessageEntry:
    taken_s = time.monotonic() - number * _SPREAD_S
    message = Message(b'x', bytes(16), number, time.time_ns())
    entry = MessageEntry(Outgoing('x', None, b'x', []), message, taken_s)
    entry.produced_s = taken_s
    return entry


def _say(what: str, size: int, call: Callable[[], object]) -> None:
    took_s = min(timeit.repeat(call, number=_CALLS, repeat=_RUNS)) / _CALLS / size
    print(f'{1e6 * took_s:8.3f} µs  {what}, {size} at once')


if __name__ == '__main__':
    main()
