"""Pausing a route: nothing moves meanwhile, nothing is lost, and the order holds."""

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from support.bridges.driven import Driven
from support.bridges.numbers_to_kafka import how_many
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.bridges.words import ROS_TOPIC, texts, wait_for, words
from support.processes.harness import Bench, eventually

COUNT = 20_000


@pytest.fixture
def driven(bench: Bench) -> Iterator[Driven]:
    """What starts a bridge that can be paused."""
    with Driven(bench) as one:
        yield one


def test_a_paused_route_to_ros_publishes_nothing_and_goes_on_where_it_was(
    bench: Bench, driven: Driven, topic: str, arrived: Path
) -> None:
    route = to_ros(topic, ROS_TOPIC, max_rate=2000)
    with bench.subscriber(ROS_TOPIC, arrived):
        driven.start([route])
        bench.produce(topic, words(COUNT))
        eventually(lambda: len(lines(arrived)) > 1000, 30, driven.output)
        driven.pause('to_ros')
        # What was in flight is confirmed and committed, and no more comes.
        eventually(partial(settled, driven), 20, driven.output)
        confirmed = driven.last('to_ros').confirmed
        assert 1000 < confirmed < COUNT
        eventually(lambda: bench.committed(bench.group, topic) == confirmed, 20, driven.output)
        eventually(lambda: len(lines(arrived)) == confirmed, 20, driven.output)
        driven.wait_for_snapshots(20)
        assert len(lines(arrived)) == confirmed
        eventually(lambda: driven.last('to_ros').lag == COUNT - confirmed, 20, driven.output)
        driven.order('resume to_ros')
        wait_for(arrived, texts(words(COUNT)), driven.process, 60)
        assert driven.process.end() == 0
    assert driven.last('to_ros').confirmed == COUNT
    assert driven.last('to_ros').repeated == 0
    assert all(snapshot.balanced for snapshot in driven.snapshots('to_ros'))


def settled(driven: Driven) -> bool:
    """Whether the route to ROS pauses, and all that it has published is counted."""
    # A subscriber has acknowledged a moment before that counts as confirmed.
    *_, before, now = {s.made_s: s for s in driven.snapshots('to_ros')}.values()
    return all(s.state == 'paused' and s.measures.queued == 0 for s in (before, now))


def test_a_paused_route_stays_in_its_group_and_tells_how_far_it_is_behind(
    bench: Bench, driven: Driven, topic_name: str, arrived: Path
) -> None:
    bench.create_topic(topic_name, partitions=2)
    kafka = {'bootstrap.servers': bench.bootstrap_servers, 'max.poll.interval.ms': 10_000,
             'session.timeout.ms': 6000}  # fmt: skip
    with bench.subscriber(ROS_TOPIC, arrived):
        driven.start([to_ros(topic_name, ROS_TOPIC)], kafka=kafka)
        driven.wait_for_state('to_ros', 'running')
        bench.produce(topic_name, words(10), partition=0)
        eventually(lambda: len(lines(arrived)) == 10, 30, driven.output)
        driven.pause('to_ros')
        bench.produce(topic_name, words(100, start=10), partition=0)
        # Longer than a client may stay away that does not poll.
        before_s = time.monotonic()
        eventually(lambda: time.monotonic() > before_s + 12, 60)
        eventually(lambda: driven.last('to_ros').lag == 100, 20, driven.output)
        assert driven.last('to_ros').measures.rebalances == 1
        assert len(lines(arrived)) == 10
        driven.order('resume to_ros')
        wait_for(arrived, texts(words(110)), driven.process)
        assert driven.process.end() == 0
    assert driven.last('to_ros').measures.rebalances == 1


@pytest.mark.parametrize('start', ['latest', 'earliest'])
def test_a_route_that_begins_paused_takes_nothing_before_it_is_resumed(
    bench: Bench, driven: Driven, topic: str, arrived: Path, start: str
) -> None:
    route = to_ros(topic, ROS_TOPIC)
    route['from'] = {'kafka': topic, 'start': start}
    with bench.subscriber(ROS_TOPIC, arrived):
        driven.start([route], 'to_ros')
        driven.wait_for_state('to_ros', 'paused')
        driven.process.wait_for('first start of this group')
        bench.produce(topic, words(50))
        driven.wait_for_snapshots(15)
        assert lines(arrived) == []
        driven.order('resume to_ros')
        wait_for(arrived, texts(words(50)), driven.process)
        assert driven.process.end() == 0


def test_a_paused_route_from_ros_holds_its_publisher_back(
    bench: Bench, driven: Driven, topic: str
) -> None:
    route = to_kafka(ROS_TOPIC, topic)
    route['from'] |= {'max_samples': 500}
    driven.start([route])
    with bench.publisher(ROS_TOPIC, '--count', str(COUNT), '--rate', '4000') as publisher:
        eventually(partial(bench.reaches, topic, 1000), 60, driven.output)
        driven.pause('to_kafka')
        eventually(lambda: driven.last('to_kafka').in_flight == 0, 20, driven.output)
        end = bench.end_offset(topic)
        driven.wait_for_snapshots(30)
        assert bench.end_offset(topic) == end == driven.last('to_kafka').confirmed
        assert driven.last('to_kafka').measures.matched == 1
        assert 'published' not in publisher.output()
        driven.order('resume to_kafka')
        publisher.wait_for(f'published {COUNT}', 60)
        eventually(partial(bench.reaches, topic, COUNT), 60, driven.output)
        assert driven.process.end() == 0
    assert values(bench.records(topic, COUNT)) == words(COUNT)
    last = driven.last('to_kafka')
    assert (last.confirmed, last.lost_upstream) == (COUNT, 0)
    assert all(snapshot.balanced for snapshot in driven.snapshots('to_kafka'))


@pytest.mark.parametrize(
    ('options', 'all_counted'),
    [(('--depth', '1'), True), (('--reliability', 'best_effort'), False)],
    ids=['KEEP_LAST', 'best effort'],
)
def test_a_paused_route_costs_other_publishers_what_they_send_meanwhile(
    bench: Bench,
    driven: Driven,
    topic: str,
    tmp_path: Path,
    options: tuple[str, ...],
    *,
    all_counted: bool,
) -> None:
    until = tmp_path / 'until'
    route = to_kafka(ROS_TOPIC, topic)
    route['from'] |= {'max_samples': 500}
    driven.start([route])
    options = (*options, '--rate', '2000', '--until', str(until))
    with bench.publisher(ROS_TOPIC, *options) as publisher:
        eventually(partial(bench.reaches, topic, 500), 60, driven.output)
        driven.pause('to_kafka')
        driven.wait_for_snapshots(30)
        until.touch()
        publisher.wait_for('published ')
        count = how_many(publisher)
        driven.order('resume to_kafka')
        driven.wait_for_state('to_kafka', 'running')
        driven.wait_for_snapshots(30)
        assert driven.process.end() == 0
    last = driven.last('to_kafka')
    assert last.confirmed < count
    assert (last.confirmed + last.lost_upstream == count) is all_counted


def test_a_stop_takes_what_a_paused_route_has_left_in_ros(
    bench: Bench, driven: Driven, topic: str
) -> None:
    driven.start([to_kafka(ROS_TOPIC, topic)])
    driven.wait_for_state('to_kafka', 'running')
    driven.pause('to_kafka')
    with bench.publisher(ROS_TOPIC, '--count', '100', '--prefix', 'late ') as publisher:
        publisher.wait_for('published 100')
        driven.wait_for_snapshots(10)
        assert bench.end_offset(topic) == 0
        assert driven.process.end() == 0
    received = values(bench.records(topic, 100))
    assert received == [b'late %d' % number for number in range(100)]


def test_pausing_one_route_leaves_the_others_alone(
    bench: Bench, driven: Driven, topic: str, arrived: Path
) -> None:
    other = f'{topic}.other'
    bench.create_topic(other)
    routes = [to_ros(topic, '/one', name='one'), to_ros(other, ROS_TOPIC, name='two')]
    with bench.subscriber(ROS_TOPIC, arrived):
        driven.start(routes)
        driven.order('pause one')
        driven.order('pause nobody')
        driven.wait_for_state('one', 'paused')
        driven.process.wait_for('pause nobody: False')
        driven.process.wait_for('one: paused by an operator')
        driven.wait_for_state('two', 'running')
        bench.produce(other, words(100))
        wait_for(arrived, texts(words(100)), driven.process)
        assert driven.process.end() == 0
