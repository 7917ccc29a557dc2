"""What is in flight, seen by itself; what becomes of it in a route is told by the worlds."""

import gc

import pytest

from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.records import RecordEntry, RecordFlight
from ros2_kafka_bridge.testing.memory import MemoryRecord


def taken(flight: RecordFlight, *offsets: int, partition: int = 0) -> list[RecordEntry]:
    entries = [RecordEntry(MemoryRecord(b'x', offset, partition), 0.0) for offset in offsets]
    flight.take(entries, partition)
    return entries


def test_a_position_is_that_behind_all_that_has_ended_in_whatever_order() -> None:
    flight = RecordFlight(10, 10_000)
    one, two, three, four = taken(flight, 1, 2, 7, 8)
    flight.end([three, two], Outcome.DROPPED)
    assert flight.positions() == {}
    flight.end([one], Outcome.CONFIRMED)
    assert flight.positions() == {0: 8}
    assert flight.positions() == {}
    flight.end([four], Outcome.CONFIRMED)
    assert flight.positions() == {0: 9}


def test_partitions_do_not_wait_for_each_other() -> None:
    flight = RecordFlight(10, 10_000)
    taken(flight, 1)
    flight.end(taken(flight, 5, 6, partition=1), Outcome.CONFIRMED)
    assert flight.positions() == {1: 7}


def test_an_entry_ends_once() -> None:
    flight = RecordFlight(10, 10_000)
    entries = taken(flight, 1, 2)
    flight.end(entries[:1], Outcome.CONFIRMED)
    with pytest.raises(AttributeError):
        flight.end(entries[:1], Outcome.DROPPED)
    assert len(flight) == 2


def test_who_keeps_an_entry_that_has_ended_keeps_none_that_came_behind_it() -> None:
    flight = RecordFlight(10, 10_000)
    gc.collect()
    before = sum(isinstance(it, RecordEntry) for it in gc.get_objects())
    kept = [before_it := taken(flight, 0)[0]]
    for offset in range(1, 1000):
        (entry,) = taken(flight, offset)
        flight.end([before_it], Outcome.DROPPED)
        flight.settled()
        before_it = entry
    del entry, before_it
    gc.collect()
    assert sum(isinstance(it, RecordEntry) for it in gc.get_objects()) - before < 10
    assert kept[0].outcome is Outcome.DROPPED
