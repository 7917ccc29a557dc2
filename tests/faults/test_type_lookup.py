"""Nodes that neither ask for a type nor tell one: what they publish comes, and comes to them.

Fast DDS 3 asks for a type that the process does not use yet, once, and shows and matches nobody of
it before the answer: where the publisher that it asked is killed before it answers, no other of
that type is seen any more. A node that hears nothing of types is such a publisher.
"""

from functools import partial

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.processes.harness import Bench, eventually
from support.processes.preloads import library

COUNT = 100


@pytest.fixture(autouse=True)
def over_udp(monkeypatch: pytest.MonkeyPatch) -> None:
    """What goes through shared memory cannot be dropped."""
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')


def test_a_publisher_killed_before_it_told_its_type_hides_no_later_one_guarantee_2(
    bench: Bench, topic: str
) -> None:
    route = to_kafka('/orders', topic)
    del route['from']['type']  # the bridge does not use it before it has found the publisher
    options = ('--count', str(COUNT), '--prefix')
    with bench.drained(bench.config([route])) as bridge:
        mute = library('no_types', bench.place)
        with bench.publisher('/orders', *options, 'first ', LD_PRELOAD=mute) as first:
            eventually(partial(bench.reaches, topic, COUNT), 60, bridge.output)
            first.kill()
        with bench.publisher('/orders', *options, 'later '):
            eventually(partial(bench.reaches, topic, 2 * COUNT), 60, bridge.output)
    sent = [f'{who} {number}'.encode() for who in ('first', 'later') for number in range(COUNT)]
    assert values(bench.records(topic, len(sent))) == sent
    assert totals(bridge, 'to_kafka')['confirmed'] == len(sent)


def test_a_subscriber_that_hears_of_no_type_gets_all_guarantee_1(bench: Bench, topic: str) -> None:
    file = bench.place / 'orders'
    sent = [f'{number}' for number in range(COUNT)]
    bench.produce(topic, [order.encode() for order in sent])
    deaf = library('no_types', bench.place)
    with bench.subscriber('/orders', file, LD_PRELOAD=deaf) as subscriber:
        subscriber.wait_for('ready')
        with bench.drained(bench.config([to_ros(topic, '/orders')])) as bridge:
            eventually(lambda: len(lines(file)) >= COUNT, 60, bridge.output)
    assert lines(file) == sent
    assert totals(bridge)['confirmed'] == COUNT
