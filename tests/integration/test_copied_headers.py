"""What others write proves nothing (guarantee 6b): headers that others copy or forge.

The bridge, the processor and the stranger are real ones on a real Kafka. What takes longer is in
tests/faults/test_forged_headers.py.
"""

from pathlib import Path

from support.bridges.letters import done
from support.bridges.numbers_to_kafka import LATCHED, seqs
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.bridges.words import wait_for_commit
from support.kafka.forgery import copied, forge, true_ones
from support.processes.harness import Bench, eventually, headers
from support.processes.lifetimes import Leave


def test_guarantee_6b_the_commands_of_a_processor_that_copies_headers_reach_the_robot(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    commands, arrived = f'{topic_name}.commands', tmp_path / 'arrived'
    bench.create_topic(topic_name, commands)
    routes = [to_kafka('/status', topic_name, 'status'), to_ros(commands, '/commands')]
    with (
        bench.bridge(bench.config(routes)) as bridge,
        bench.subscriber('/commands', arrived),
        bench.publisher('/status', '--count', '10'),
    ):
        for record in bench.records(topic_name, 10):
            bench.produce(commands, [b'go ' + (record.value() or b'')], headers=copied(record))
        eventually(lambda: len(lines(arrived)) >= 10, 60, bridge.output)
        wait_for_commit(bench, commands, 10, bridge)
        assert bridge.end() == 0
    assert lines(arrived) == [f'go {number}' for number in range(10)]
    assert totals(bridge)['confirmed'] == 10


def test_guarantee_6b_a_retry_job_that_would_make_orders_go_round_loses_nothing(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    """It copies what came back to where it came from, beside the file of the README."""
    returned, arrived, count = f'{topic_name}.returned', tmp_path / 'arrived', 20
    bench.create_topic(topic_name, returned)
    routes = [to_ros(topic_name, '/orders'), to_kafka('/orders', returned, 'orders_returned')]
    config = bench.config(routes)
    orders = [b'%d' % number for number in range(count)]
    with bench.bridge(config) as bridge, bench.subscriber('/orders', arrived):
        bench.produce(topic_name, orders)
        for record in bench.records(returned, count):
            bench.produce(topic_name, [record.value()], headers=copied(record))
        wait_for_commit(bench, topic_name, 2 * count, bridge)
        letters = bench.records(f'{topic_name}.dead-letters', count)
        assert values(letters) == orders
        assert all('LoopError: ' in headers(letter)['dead_letter.error'] for letter in letters)
        assert 0 < bridge.output().count('dead_letter: ') < 5, 'not a line for each'
        # Who means it sends them once more.
        assert f'{count} letters replayed to {topic_name}\n' in done(
            bench, 'replay', config, '--route', 'to_ros'
        )
        eventually(lambda: len(lines(arrived)) >= 2 * count, 60, bridge.output)
        assert bridge.end() == 0
    assert lines(arrived) == 2 * [order.decode() for order in orders]
    assert totals(bridge)['dead-lettered'] == count


def test_guarantee_6b_forged_numbers_before_a_restart_cost_a_latched_publisher_nothing(
    bench: Bench, leave: Leave, topic: str
) -> None:
    """The stranger copies every header of the bridge, and knows all but what is still to come."""
    config = bench.config([to_kafka('/orders', topic)])
    options = (*LATCHED, *leave.options, '--count', '35')
    with bench.publisher('/orders', *options) as publisher:
        leave.up_to(5)
        with bench.drained(config) as bridge:
            eventually(lambda: bench.reaches(topic, 5), 60, bridge.output)
        last = bench.records(topic, 5)[-1]
        forge(bench, topic, last, range(6, 41))
        with bench.drained(config) as bridge:
            leave.up_to(35)
            publisher.wait_for('published')
            eventually(lambda: len(true_ones(bench, topic)) >= 35, 60, bridge.output)
    assert seqs(true_ones(bench, topic)) == list(range(1, 36)), 'nor was any repeated'
    assert totals(bridge, 'to_kafka')['skipped'] == 5
    assert totals(bridge, 'to_kafka')['sent though their number is there'] == 30
    assert 0 < bridge.output().count('proves nothing') < 5, 'not a line for each'
