"""The records that letters tell of are read some at a time, and kept as far as they may."""

from collections.abc import Iterator

import pytest

from ros2_kafka_bridge.endpoints import HeaderList, Record
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka import letters as under_test
from ros2_kafka_bridge.kafka.letters import Original, Originals
from ros2_kafka_bridge.testing.memory import MemoryRecord


class Topic:
    """A topic whose partitions hold offsets 100 to 4999, each with one header of that size."""

    def __init__(self, header_bytes: int = 10, gone: frozenset[int] = frozenset()) -> None:
        self.reads: list[range] = []
        self.failure: Exception | None = None
        self._header: HeaderList = [('trace', b'x' * header_bytes)]
        self._gone = gone

    def bounds(self, _topic: str, partition: int, _offset: int) -> range:
        if self.failure is not None:
            raise self.failure
        return range(100, 5000) if partition < 40 else range(0)

    def records(self, _topic: str, partition: int, offsets: range) -> Iterator[Record]:
        self.reads.append(offsets)
        for offset in offsets:
            if offset not in self._gone:
                yield MemoryRecord(b'%d' % offset, offset, partition, header_list=self._header)


def originals(topic: Topic) -> Originals:
    return Originals(topic)  # type: ignore[arg-type]


def test_letters_in_the_order_of_their_records_cost_few_reads_also_of_several_partitions() -> None:
    topic = Topic()
    found = originals(topic)
    for offset in range(100, 4100):
        for partition in range(10):
            original = found.fetch('orders', partition, offset)
            assert original.record is not None
            assert original.record.value() == b'%d' % offset
            assert original.record.partition() == partition
    assert len(topic.reads) == 40


def test_it_tells_what_is_gone_from_what_never_was() -> None:
    found = originals(Topic(gone=frozenset({150})))
    assert found.fetch('orders', 0, 99) == Original(None)
    assert found.fetch('orders', 0, 150) == Original(None)
    assert found.fetch('orders', 0, 100).record is not None, 'behind what is gone'
    assert found.fetch('orders', 0, 4999).record is not None
    for partition, offset in ((0, 5000), (0, 2**62), (40, 100), (40, 0)):
        assert found.fetch('orders', partition, offset) == Original(None, was_there=False)


def test_who_may_not_look_is_told_of_nothing_and_asks_again_each_time() -> None:
    topic = Topic()
    topic.failure = RouteError('no right')
    found = originals(topic)
    assert found.fetch('orders', 0, 100) == Original(None)
    topic.failure = None
    assert found.fetch('orders', 0, 100).record is not None


def test_large_headers_and_many_partitions_are_kept_within_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(under_test, '_MOST_PARTS', 3)
    found = originals(Topic(header_bytes=300_000))
    for partition in range(20):
        assert found.fetch('orders', partition, 100).record is not None
    kept = [len(ahead.records) for ahead in found._ahead.values()]
    assert kept == [4, 4, 4]
