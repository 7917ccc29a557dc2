"""What routes measure of real traffic, at every moment of it."""

import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest
from support.bridges.driven import Driven
from support.bridges.routes import lines, to_kafka, to_ros
from support.bridges.words import ROS_TOPIC, words
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.route.counters import Snapshot

COUNT = 20_000
CDR_BYTES = 4 + 4 + 20 + 1  # encapsulation, length, text, NUL; padding may follow


@pytest.fixture
def driven(bench: Bench) -> Iterator[Driven]:
    """What starts a bridge whose snapshots are read."""
    with Driven(bench) as one:
        yield one


def check(snapshots: Sequence[Snapshot]) -> None:
    """All counts of each snapshot are of one moment, and none goes back."""
    for snapshot in snapshots:
        measures = snapshot.measures
        assert snapshot.balanced, snapshot
        assert sum(measures.in_bridge.counts) == snapshot.confirmed
        assert measures.bytes_taken >= measures.bytes_confirmed
    for before, after in itertools.pairwise(snapshots):
        assert after.made_s >= before.made_s
        assert after.measures.bytes_taken >= before.measures.bytes_taken
        assert after.measures.end_to_end.sum_s >= before.measures.end_to_end.sum_s
        assert all(
            b <= a
            for b, a in zip(
                before.measures.in_bridge.counts, after.measures.in_bridge.counts, strict=True
            )
        )


def test_the_measures_fit_the_counters_at_every_moment_under_load(
    bench: Bench, driven: Driven, topic_name: str
) -> None:
    returned = f'{topic_name}.returned'
    bench.create_topic(topic_name, partitions=2)
    bench.create_topic(returned)
    driven.start(
        [to_ros(topic_name, ROS_TOPIC, max_rate=3000), to_kafka(ROS_TOPIC, returned)],
        monitoring={'listen': 'off'},
        kafka=bench.patient_kafka,
    )
    driven.wait_for_state('to_ros', 'running')
    sent: list[bytes | None] = [b'%020d' % number for number in range(COUNT)]
    bench.produce(topic_name, sent[: COUNT // 2], partition=0)
    bench.produce(topic_name, sent[COUNT // 2 :], partition=1)
    eventually(partial(bench.reaches, returned, COUNT), 90, driven.output)
    eventually(lambda: driven.last('to_kafka').confirmed == COUNT, 20, driven.output)
    assert driven.last('to_ros').measures.matched == 1
    assert driven.last('to_kafka').measures.matched == 1
    assert driven.process.end() == 0
    one, two = driven.snapshots('to_ros'), driven.snapshots('to_kafka')
    check(one)
    check(two)
    assert max(snapshot.lag or 0 for snapshot in one) > 1000
    assert any(snapshot.measures.broker_round_trip_s for snapshot in two)
    assert all(any(it.measures.queue_limit for it in told) for told in (one, two))

    to, back = driven.last('to_ros'), driven.last('to_kafka')
    assert to.confirmed == back.confirmed == COUNT
    assert to.measures.bytes_taken == to.measures.bytes_confirmed == 20 * COUNT
    assert CDR_BYTES * COUNT <= back.measures.bytes_taken <= (CDR_BYTES + 3) * COUNT
    assert back.measures.bytes_confirmed == back.measures.bytes_taken
    assert sum(to.measures.published.counts) == COUNT
    assert to.measures.published.sum_s <= to.measures.in_bridge.sum_s
    for measures in (to.measures, back.measures):
        assert sum(measures.end_to_end.counts) == COUNT
        assert measures.errors == {}
        assert measures.troubles == ()
        assert measures.queue_limit is None, 'it does not run any more'
    assert sum(back.measures.round_trip.counts) == COUNT
    assert back.measures.round_trip.sum_s <= back.measures.in_bridge.sum_s
    assert to.measures.broker_round_trip_s is None
    assert to.measures.rebalances == 1
    # Most records have waited for their turn by max_rate, in Kafka and in the bridge.
    assert to.measures.end_to_end.sum_s > to.measures.in_bridge.sum_s


def test_records_that_cannot_be_read_are_errors_with_their_place(
    bench: Bench, driven: Driven, topic: str, arrived: Path
) -> None:
    with bench.subscriber(ROS_TOPIC, arrived):
        driven.start([to_ros(topic, ROS_TOPIC, on_error='drop')])
        bench.produce(topic, [*words(3), b'\xff', b'\xff', *words(2, start=3)])
        eventually(lambda: len(lines(arrived)) == 5, 30, driven.output)
        eventually(lambda: driven.last('to_ros').confirmed == 5, 20, driven.output)
        assert driven.process.end() == 0
    last = driven.last('to_ros')
    assert last.measures.errors == {'DecodeError': 2}
    [trouble] = last.measures.troubles
    assert trouble.times == 2
    assert trouble.text.startswith(f'{topic}[0]@4: ')
    assert last.measures.bytes_taken == last.measures.bytes_confirmed + 2


def test_a_route_that_fails_tells_why_and_how_often(
    driven: Driven, topic_name: str, tmp_path: Path
) -> None:
    no_folder = tmp_path / 'file'
    no_folder.touch()
    driven.start([to_kafka(ROS_TOPIC, topic_name, spool={'path': str(no_folder / 'spool')})])
    eventually(
        lambda: driven.last('to_kafka').measures.errors.get('RouteError', 0) > 1,
        40,
        driven.output,
    )
    last = driven.last('to_kafka')
    [trouble] = last.measures.troubles
    assert str(no_folder) in trouble.text
    assert trouble.times > 1
    assert last.beat_s == 0
    driven.process.end()


def test_endpoints_that_do_not_match_are_counted_until_they_go(
    bench: Bench, driven: Driven, topic: str, tmp_path: Path
) -> None:
    routes = [
        to_ros(topic, ROS_TOPIC),
        to_kafka('/volatile', topic) | {'from': {
            'ros': '/volatile', 'type': 'std_msgs/msg/String',
            'qos': {'durability': 'transient_local'},
        }},
    ]  # fmt: skip
    driven.start(routes)
    driven.wait_for_state('to_ros', 'running')

    def ends(route: str) -> tuple[int | None, int | None]:
        measures = driven.last(route).measures
        return measures.matched, measures.mismatched

    latched = ('--durability', 'transient_local')
    with (
        bench.subscriber(ROS_TOPIC, tmp_path / 'right'),
        bench.subscriber(ROS_TOPIC, tmp_path / 'wrong', *latched),
        bench.publisher('/volatile', '--count', '1', '--readers', '0'),
        bench.publisher('/volatile', '--count', '1', '--readers', '0', *latched),
    ):
        eventually(lambda: ends('to_ros') == (1, 1), 60, driven.output)
        eventually(lambda: ends('to_kafka') == (1, 1), 60, driven.output)
    eventually(lambda: ends('to_ros') == (0, 0), 60, driven.output)
    eventually(lambda: ends('to_kafka') == (0, 0), 60, driven.output)
    assert driven.process.end() == 0


def test_what_waits_on_disk_is_measured(
    bench: Bench, driven: Driven, topic: str, tmp_path: Path
) -> None:
    spool = {'path': str(tmp_path / 'spool'), 'mode': 'always'}
    # What comes back from disk counts by its record's value: here that is the message itself.
    driven.start([to_kafka(ROS_TOPIC, topic, spool=spool) | {'format': 'cdr'}])
    with bench.publisher(ROS_TOPIC, '--count', '5000', '--rate', '1000', '--size', '100') as one:
        one.wait_for('published 5000', 60)
    eventually(lambda: driven.last('to_kafka').confirmed == 5000, 60, driven.output)
    assert driven.process.end() == 0
    check(driven.snapshots('to_kafka'))
    assert max(s.measures.spool_bytes or 0 for s in driven.snapshots('to_kafka')) > 100
    last = driven.last('to_kafka').measures
    assert last.bytes_confirmed == last.bytes_taken
