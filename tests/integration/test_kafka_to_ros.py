"""Kafka -> ROS as its users see it: what it waits for, and what it drops and skips.

The numbers in the names are those of the guarantees that the tests prove.
"""

import time
from pathlib import Path

from support.bridges.routes import lines, to_ros, totals
from support.bridges.words import ROS_TOPIC, texts, wait_for, wait_for_commit, words
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import Leave


def test_guarantee_4_records_wait_until_min_subscribers_are_there(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    first, second = tmp_path / 'first', tmp_path / 'second'
    bench.produce(topic, words(100))
    config = bench.config([to_ros(topic, ROS_TOPIC, min_subscribers=2)])
    with bench.subscriber(ROS_TOPIC, first), bench.bridge(config) as bridge:
        bridge.wait_for('waiting (1 of 2 subscribers are there)')
        assert lines(first) == []
        assert bench.committed(bench.group, topic) == 0
        with bench.subscriber(ROS_TOPIC, second):
            wait_for(second, texts(words(100)), bridge)
            wait_for(first, texts(words(100)), bridge)
            assert bridge.end() == 0
    assert totals(bridge)['confirmed'] == 100


def test_guarantee_6c_with_min_subscribers_0_records_go_to_nobody_and_nobody_confirms_them(
    bench: Bench, topic: str
) -> None:
    bench.produce(topic, words(2000))
    config = bench.config([to_ros(topic, ROS_TOPIC, min_subscribers=0)])
    with bench.drained(config) as bridge:
        wait_for_commit(bench, topic, 2000, bridge)
    assert (totals(bridge)['confirmed'], totals(bridge)['only published']) == (0, 2000)


def test_guarantee_1_max_rate_is_kept_and_a_keep_last_subscriber_then_loses_nothing(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """At one in 1,000 s each bridge moves one and one that is owed; a queue of two holds them."""
    bench.produce(topic, words(6))
    config = bench.config([to_ros(topic, ROS_TOPIC, max_rate=0.001)])
    moved = 0
    with bench.subscriber(ROS_TOPIC, arrived, '--depth', '2'):
        while moved < 6:
            moved += moved_by_one_bridge(bench, config, arrived)


def moved_by_one_bridge(bench: Bench, config: Path, arrived: Path) -> int:
    before = len(lines(arrived))
    with bench.drained(config) as bridge:
        eventually(lambda: len(lines(arrived)) > before, 60, bridge.output)
    moved = totals(bridge)['confirmed']
    assert 0 < moved <= 2
    wait_for(arrived, texts(words(before + moved)), bridge)
    return moved


def test_guarantee_6_records_older_than_max_age_s_are_dropped_and_counted(
    bench: Bench, topic: str, arrived: Path
) -> None:
    hour_ago_ms = int(time.time() * 1000) - 3_600_000
    bench.produce(topic, words(10))
    bench.produce(topic, words(7, start=10), timestamp=hour_ago_ms)
    bench.produce(topic, words(10, start=17))
    config = bench.config([to_ros(topic, ROS_TOPIC, max_age_s=600)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, texts([*words(10), *words(10, start=17)]), bridge)
        wait_for_commit(bench, topic, 27, bridge)
    assert totals(bridge)['confirmed'] == 20
    assert totals(bridge)['dropped'] == 7


def test_guarantee_6_a_record_that_would_go_round_is_skipped_and_counted_if_the_route_says_so(
    bench: Bench, topic: str, arrived: Path
) -> None:
    mine = [('ros.topic', ROS_TOPIC.encode()), ('bridge.origin', bench.name.encode())]
    bench.produce(topic, words(5), headers=[('bridge.origin', b'another')])
    bench.produce(topic, words(3, start=5), headers=mine)
    bench.produce(topic, words(5, start=8))
    config = bench.config([to_ros(topic, ROS_TOPIC, skip_own=True)])
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config) as bridge:
        wait_for(arrived, texts([*words(5), *words(5, start=8)]), bridge)
        wait_for_commit(bench, topic, 13, bridge)
    assert totals(bridge)['confirmed'] == 10
    assert totals(bridge)['skipped'] == 3


def test_guarantee_4_a_stopped_subscriber_holds_back_one_route_alone(
    bench: Bench, leave: Leave, topic_name: str, arrived: Path, tmp_path: Path
) -> None:
    other, others = f'{topic_name}.other', tmp_path / 'others'
    bench.create_topic(topic_name, other)
    bench.produce(topic_name, words(4000))
    config = bench.config([to_ros(topic_name, ROS_TOPIC), to_ros(other, '/others', 'others')])
    leave.up_to(100)
    with (
        bench.subscriber(ROS_TOPIC, arrived, *leave.options, samples=50),
        bench.subscriber('/others', others),
        bench.drained(config) as bridge,
    ):
        eventually(lambda: len(lines(arrived)) == 100, 60, bridge.output)
        bench.produce(other, words(5000))
        wait_for(others, texts(words(5000)), bridge)
        assert bench.committed(bench.group, topic_name) <= 100 + 50
        leave.up_to(4000)
        wait_for(arrived, texts(words(4000)), bridge)
