"""ROS -> Kafka with a spool, while the broker is away and the bridge is killed.

The guarantees are those of docs: 2 at least once, 3 order, 4 full means wait, 6 counters balance,
7 stop is a drain, 8 what SIGKILL can cost. docs/spool.md has the same table of costs.
"""

import logging

import pytest
from support.bridges.numbers_to_kafka import LATCHED, knock
from support.bridges.routes import totals
from support.bridges.spooled import RATE, WINDOW, arrived, file, numbers, on_disk, route
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave
from support.spools.files import newest_on_disk

from ros2_kafka_bridge.spool.store import Spool
from ros2_kafka_bridge.testing.local_kafka import LocalKafka


def spooled(bench: Bench) -> list[int]:
    """The messages that a killed bridge has left on disk, in their order."""
    spool = Spool(file(bench), sync=False, log=logging.LoggerAdapter(logging.getLogger('test')))
    spool.open()
    try:
        return [int(row.record.value or b'') for row in spool.read(0, 10**6, 1 << 40)]
    finally:
        spool.close()


def dies_with_all_on_disk(
    bench: Bench, kafka: LocalKafka, bridge: Process, leave: Leave, count: int
) -> None:
    """Kafka first, then the bridge, once all that is published is on its disk."""
    leave.set_off(count)
    kafka.kill()
    eventually(lambda: newest_on_disk(file(bench)) == count, 120, bridge.output)
    bridge.kill()


@pytest.mark.kills_kafka
def test_sigkill_while_kafka_is_away_costs_nothing_of_what_was_taken_guarantees_2_3_8(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    count = 4000
    config = own_bench.config([route(own_bench, own_topic)])
    leave = Leave(own_bench.place)
    options = (*leave.options, '--count', str(count), '--rate', str(RATE))
    with own_bench.publisher('/orders', *options):
        with own_bench.bridge(config) as bridge:
            leave.up_to(500)
            eventually(lambda: arrived(own_bench, own_topic) == 500, 60, bridge.output)
            dies_with_all_on_disk(own_bench, own_kafka, bridge, leave, count)
        with own_bench.drained(config) as bridge:
            bridge.wait_for('the spool holds')
            own_kafka.start()
            bridge.wait_for('the spool is empty again', timeout_s=60)
    found = numbers(own_bench, own_topic)
    assert list(dict.fromkeys(found)) == list(range(count))
    assert len(found) - count <= WINDOW, 'what was in flight when Kafka died may come twice'


def test_always_costs_nothing_that_was_taken_at_a_sigkill_under_load_guarantee_8(
    bench: Bench, topic: str
) -> None:
    alone, count, leave = 3000, 4000, Leave(bench.place)
    config = bench.config([route(bench, topic, mode='always')], ros={'lease_s': 3})
    options = (*leave.options, '--count', str(count), '--rate', str(RATE))
    with bench.publisher('/orders', *options) as publisher:
        with bench.bridge(config) as bridge:
            leave.up_to(500)
            eventually(lambda: arrived(bench, topic) == 500, 60, bridge.output)
            leave.set_off(alone)
            bridge.kill()
        eventually(lambda: leave.out == alone, 60)
        delivered = numbers(bench, topic)
        taken = list(dict.fromkeys([*delivered, *spooled(bench)]))
        assert taken == list(range(len(taken))), 'each is on disk before it goes on'
        with bench.drained(config) as again:
            again.wait_for('subscribes to /orders')
            eventually(lambda: on_disk(bench) == 0, 60, again.output)
            knock(bench, topic, leave)
            back = leave.out
            leave.up_to(count)
            publisher.wait_for('published')
            eventually(lambda: numbers(bench, topic)[-1] == count - 1, 60, again.output)
    found = numbers(bench, topic)
    first = list(dict.fromkeys(found))
    first_after = first[len(taken)]
    assert first == [*taken, *range(first_after, count)]
    assert alone <= first_after < back, 'all is there that was published once it was back'
    assert len(found) - len(first) <= WINDOW


def test_a_stop_while_kafka_is_away_gives_nothing_up_guarantees_6_7(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    count = 3000
    config = own_bench.config([route(own_bench, own_topic)], defaults={'drain_s': 5})
    own_kafka.stop()
    with own_bench.publisher('/orders', '--count', str(count)) as publisher:
        with own_bench.drained(config) as bridge:
            publisher.wait_for('published', timeout_s=60)
            eventually(lambda: on_disk(own_bench) == count, 60)
        assert (
            totals(bridge, 'to_kafka')['taken'] == totals(bridge, 'to_kafka')['spooled'] == count
        )
        own_kafka.start()
        with own_bench.drained(config) as bridge:
            bridge.wait_for('the spool is empty again', timeout_s=60)
        assert (
            totals(bridge, 'to_kafka')['taken'] == totals(bridge, 'to_kafka')['confirmed'] == count
        )
    found = numbers(own_bench, own_topic)
    assert found == list(range(count))


@pytest.mark.kills_kafka
def test_a_latched_publisher_and_a_spool_repeat_nothing_guarantees_2_8(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    count = 3000
    config = own_bench.config([route(own_bench, own_topic)])
    leave = Leave(own_bench.place)
    options = (*LATCHED, *leave.options, '--count', str(count), '--rate', str(RATE))
    with own_bench.publisher('/orders', *options):
        with own_bench.bridge(config) as bridge:
            leave.up_to(300)
            eventually(lambda: arrived(own_bench, own_topic) == 300, 60, bridge.output)
            dies_with_all_on_disk(own_bench, own_kafka, bridge, leave, count)
        own_kafka.start()
        with own_bench.drained(config) as bridge:
            bridge.wait_for('the spool is empty again', timeout_s=60)
            records = own_bench.records(own_topic, count)
    found = [int(headers(record)['ros.seq']) for record in records]
    assert list(dict.fromkeys(found)) == list(range(1, count + 1))
    assert len(found) - count <= WINDOW
