"""Whatever a foreign library raises, in whichever call: only the route of that call fails.

Guarantee 5: one table says for every foreign error what is done about it.
"""

import itertools
import re
import sys
import time
from pathlib import Path

import pytest
from support.bridges.numbers_to_kafka import how_many
from support.bridges.routes import to_kafka, to_ros, values
from support.processes.harness import PEERS, Bench, Process, eventually

WITHIN_S = '30'
# Met while nothing comes, behind a full window, or at the very end: unit tests let them fail.
RARE = {
    ('to_kafka', 'Consumer.close'),
    ('to_ros', 'Consumer.offsets_for_times'),
    ('to_ros', 'Consumer.position'),
    ('to_ros', 'Consumer.resume'),
    ('to_ros', 'Destroyable.destroy_when_not_in_use'),
}
SABOTAGED = (sys.executable, str(PEERS / 'sabotaged_bridge.py'))  # cold: it replaces imports


@pytest.mark.timeout(600)  # some thirty lives of a bridge, each of nine seconds
@pytest.mark.parametrize(
    ('kind', 'durability'), [('refused', 'volatile'), ('fatal', 'transient_local')]
)
def test_guarantee_5_each_call_of_rclpy_and_confluent_kafka_may_fail_and_its_route_goes_on(
    bench: Bench, topic: str, kind: str, durability: str
) -> None:
    back, until, read = f'{topic}.back', bench.place / 'until', bench.place / 'read'
    routes = [to_ros(topic, '/back'), to_kafka('/numbers', back, exclusive=True)]
    bench.create_topic(back)
    sent = itertools.count()
    lives: list[list[bytes]] = []

    def sabotaged(*call: str) -> str:
        """Run such a bridge, under a name of its own; returns what it says."""
        name = f'{bench.name}-{"-".join(call).lower().replace(".", "-")}'
        command = [*SABOTAGED, str(bench.config(routes, name)), WITHIN_S, kind, *call]
        log = bench.place / f'{name}.log'
        with Process(command, log, bench.environ) as bridge:
            while 'done\n' not in bridge.output() and bridge.running:
                bench.produce(topic, [b'%d' % next(sent) for _ in range(10)])
                time.sleep(0.25)
            count = next(sent)
            bench.produce(topic, [b'%d' % count])
            eventually(lambda: numbers(count + 1) <= arrived(read), 60, bridge.output)
            assert bridge.end() == 0, bridge.output()
        # What a VOLATILE publisher sends between two lives is nobody's.
        lives.append(values(bench.records(back, bench.end_offset(back)))[sum(map(len, lives)) :])
        return bridge.output()

    with (
        bench.subscriber('/back', read),
        bench.publisher(
            '/numbers', '--durability', durability, '--rate', '20', '--until', str(until)
        ) as publisher,
    ):
        outputs = [sabotaged()]
        at_start = re.findall(r'^at start: (\S+) (\S+)', outputs[0], re.MULTILINE)
        outputs += [sabotaged(*call) for call in at_start if call not in RARE]
        until.touch()
        how_many(publisher)
    for life in lives:
        found = set(map(int, life))
        assert found == set(range(min(found, default=0), max(found, default=-1) + 1))
    output = '\n'.join(outputs)
    for bad in ('STANDS STILL', 'FAILED TOO', 'NOT MET', 'Traceback'):
        assert bad not in output
    tried = re.findall(r'^(to_\w+): (\S+): flows', output, re.MULTILINE)
    assert {route for route, _ in tried} == {'to_ros', 'to_kafka'}
    assert ('to_ros', 'Consumer.unsubscribe') in tried, 'what ends a client fails, too'
    assert {('to_ros', 'Publisher.publish_raw'), ('to_kafka', 'rcl.take')} <= {*tried}
    assert len(set(tried)) > 50


def numbers(count: int) -> set[bytes]:
    """What was sent."""
    return {b'%d' % number for number in range(count)}


def arrived(file: Path) -> set[bytes]:
    """What was read."""
    return set(file.read_bytes().split())
