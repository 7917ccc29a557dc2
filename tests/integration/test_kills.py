"""Bridges and brokers that end in mid-stream: one proof each, the others are in tests/faults.

Peers go no further than the test lets them (`Leave`): on a machine however slow no kill comes
when all is over, and none finds a history overrun.
"""

import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.bridges import spooled
from support.bridges.numbers_to_kafka import LATCHED, last, seqs
from support.bridges.numbers_to_ros import (
    ON_ITS_WAY_S,
    ROS_TOPIC,
    SAMPLES,
    SLOW,
    numbered,
    numbers,
    one_dies_and_the_next_gets_the_rest,
    steps_back,
    wait_for_all,
    wait_for_lines,
    wait_until_lost,
)
from support.bridges.routes import to_kafka, to_ros, totals, values
from support.bridges.taking_turns import (
    STANDS_BY,
    TAKES,
    assert_each_once_in_order,
    exclusive,
    now_s,
    runs,
    said_at_s,
    tell,
)
from support.bridges.taking_turns import wait_for_all as wait_for_all_of_a_pair
from support.bridges.window_limits import WINDOW, first_held_back
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import Leave

from ros2_kafka_bridge.testing.local_kafka import LocalKafka


def test_guarantees_1_and_8_a_killed_bridge_loses_nothing_and_repeats_only_uncommitted_records(
    bench: Bench, topic: str, arrived: Path, leave: Leave
) -> None:
    count = 4000
    config = bench.config([to_ros(topic, ROS_TOPIC)])
    bench.produce(topic, numbered(count))
    with bench.subscriber(ROS_TOPIC, arrived, *SLOW, *leave.options, samples=SAMPLES):
        leave.up_to(3000)
        with bench.bridge(config) as bridge:
            wait_for_lines(arrived, 500, bridge)
            eventually(lambda: bench.committed(bench.group, topic) > 0, 60, bridge.output)
            bridge.kill()
        time.sleep(ON_ITS_WAY_S)
        committed = bench.committed(bench.group, topic)
        leave.up_to(2 * count)
        with bench.drained(config) as bridge:
            wait_for_all(arrived, count, bridge)
        assert totals(bridge)['confirmed'] == count - committed
    found = numbers(arrived)
    assert found[0] == 0
    # What comes again begins at the committed offset, so that all of it lies at or above.
    assert [after for _, after in steps_back(found)] in ([committed], [])
    assert 0 < committed <= 3000 + SAMPLES
    assert bench.committed(bench.group, topic) == count


def test_guarantee_1_when_the_only_subscriber_is_killed_the_next_one_gets_what_was_in_flight(
    bench: Bench, topic: str, leave: Leave
) -> None:
    one_dies_and_the_next_gets_the_rest(bench, topic, leave, lease_s=8.0)


def test_guarantees_2_3_8_sigkill_costs_nothing_of_a_transient_local_history(
    bench: Bench, topic: str, leave: Leave
) -> None:
    count = 4000
    config = bench.config([to_kafka('/orders', topic)], ros={'lease_s': 3})
    options = (*LATCHED, *leave.options, '--count', str(count), '--rate', '500')
    with bench.publisher('/orders', *options):
        leave.up_to(1500)
        with bench.bridge(config) as bridge:
            eventually(lambda: last(bench, topic) >= 300, 60, bridge.output)
            bridge.kill()
        leave.up_to(count)
        with bench.drained(config) as bridge:
            records = bench.records(topic, count)
    assert values(records) == numbered(count)
    assert seqs(records) == list(range(1, count + 1))


def test_guarantees_1_and_3_a_restart_of_the_broker_loses_nothing_and_repeats_no_committed_record(
    own_bench: Bench, own_kafka: LocalKafka, topic_name: str, arrived: Path, leave: Leave
) -> None:
    bench, count = own_bench, 2000
    config = bench.config([to_ros(topic_name, ROS_TOPIC)])
    bench.create_topic(topic_name, partitions=2)
    bench.produce(topic_name, numbered(count), partition=0)
    with (
        bench.subscriber(ROS_TOPIC, arrived, *leave.options, samples=SAMPLES),
        bench.drained(config) as bridge,
    ):
        leave.up_to(1000)
        wait_for_lines(arrived, 1000, bridge)
        eventually(lambda: bench.committed(bench.group, topic_name) > 0, 60, bridge.output)
        committed = bench.committed(bench.group, topic_name)
        bench.close()
        own_kafka.stop()
        # Its partitions are paused just then: a full window holds them.
        wait_until_lost(bridge, topic_name)
        own_kafka.start()
        bench.produce(topic_name, numbered(count + 1000)[count:], partition=0)
        leave.up_to(2 * count)
        wait_for_all(arrived, count + 1000, bridge)
        bridge.wait_for('Kafka is back')
        # And the partition that had nothing before.
        bench.produce(topic_name, numbered(10), partition=1)
        eventually(lambda: numbers(arrived)[-10:] == list(range(10)), 60, bridge.output)
    found = numbers(arrived)
    assert found[0] == 0
    # The group may give the partition away and back: then what was in flight comes again.
    assert [one for one in steps_back(found[:-10]) if one[1] < committed] == []
    assert 'ERROR' not in bridge.output()
    assert bench.committed(bench.group, topic_name) == count + 1000


@pytest.mark.kills_kafka
def test_guarantees_2_3_4_a_broker_that_is_away_holds_the_publisher_back_and_costs_nothing(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str, leave: Leave
) -> None:
    bench, count = own_bench, 15_000
    config = bench.config([to_kafka('/orders', own_topic)])
    options = (*leave.options, '--count', str(count))
    with bench.drained(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(1000)
        eventually(lambda: bench.reaches(own_topic, 1000), 60, bridge.output)
        bench.close()
        own_kafka.kill()
        leave.up_to(1000 + WINDOW)
        held = first_held_back(bridge)
        leave.up_to(count)
        publisher.wait_for(f'held back from {held}\n')
        assert leave.out == held
        own_kafka.start()
        bridge.wait_for('Kafka is back')
        publisher.wait_for('published')
        records = bench.records(own_topic, count)
    assert totals(bridge, 'to_kafka')['confirmed'] == count
    assert values(records) == numbered(count)
    assert seqs(records) == list(range(1, count + 1))


@pytest.mark.kills_kafka
def test_guarantees_2_3_4_6_robots_are_not_held_back_while_kafka_is_away_and_nothing_is_lost(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str, leave: Leave
) -> None:
    bench, count = own_bench, 4000
    config = bench.config([spooled.route(bench, own_topic)])
    options = (*leave.options, '--count', str(count), '--rate', str(spooled.RATE))
    with bench.drained(config) as bridge, bench.publisher('/orders', *options) as publisher:
        leave.up_to(1000)
        eventually(lambda: spooled.arrived(bench, own_topic) >= 500, 60, bridge.output)
        own_kafka.kill()
        leave.up_to(count)
        publisher.wait_for('published')
        bridge.wait_for('new messages go to the spool: ')
        bridge.wait_for('Kafka is away')
        held = spooled.WINDOW + spooled.CACHE
        eventually(lambda: spooled.on_disk(bench) > held, 60, bridge.output)
        own_kafka.start()
        # What it says of its spool may be of before: a busy machine can be too slow for Kafka.
        eventually(lambda: spooled.arrived(bench, own_topic) >= count, 60, bridge.output)
    found = totals(bridge, 'to_kafka')
    assert found['taken'] == found['confirmed'] == count
    assert spooled.numbers(bench, own_topic) == list(range(count))


def test_guarantee_8_one_of_two_takes_over_from_a_killed_bridge_and_nothing_of_a_history_is_lost(
    bench: Bench, topic_name: str, leave: Leave
) -> None:
    count = 3000
    config = exclusive(bench, bench.name, topic_name)
    options = (*LATCHED, *leave.options, '--count', str(count), '--rate', '300')
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES)
        others = [stack.enter_context(bench.bridge(config)) for _ in range(2)]
        for other in others:
            other.wait_for(STANDS_BY)
        stack.enter_context(bench.publisher('/orders', *options))
        leave.up_to(300)
        eventually(lambda: bench.reaches(topic_name, 300), 60, first.output)
        assert runs(first), 'those that join change nothing'
        leave.set_off(1500)
        killed_s = now_s()
        first.kill()
        eventually(lambda: any(map(runs, others)), 60, lambda: str([o.output() for o in others]))
        [heir] = filter(runs, others)
        tell('SIGKILL to the take-over', said_at_s(heir, TAKES) - killed_s)
        # What the first had sent may still have been written after its end.
        before = bench.end_offset(topic_name)
        leave.up_to(count)
        eventually(lambda: bench.reaches(topic_name, before + 1), 60, heir.output)
        tell('SIGKILL to the first record of the other', now_s() - killed_s)
        records = wait_for_all_of_a_pair(bench, topic_name, count, *others)
        assert [runs(other) for other in others].count(True) == 1
        assert [other.end() for other in others] == [0, 0]
    assert_each_once_in_order(records, count)
