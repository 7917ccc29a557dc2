"""Numbers from Kafka to a subscriber that is slow: what has arrived, and where it begins again.

A record's value is its number in its partition, which is also its offset. Subscribers that have
to be slow take few samples into their DDS cache, so that the bridge's window is in flight
whenever something happens.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

from support.bridges.routes import lines, to_ros, totals
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave

ROS_TOPIC = '/numbers'
SAMPLES = 50  # in the DDS cache of a slow subscriber
ON_ITS_WAY_S = 1.0  # a commit that a killed bridge has sent, until the broker has done it
SLOW = ('--work', '0.001')  # 0.8 messages/ms or so


def numbered(count: int) -> list[bytes]:
    """So many numbers, as they are written."""
    return [b'%d' % number for number in range(count)]


def numbers(file: Path) -> list[int]:
    """The numbers that a subscriber has got."""
    return [int(line) for line in lines(file)]


def wait_for_lines(file: Path, count: int, *processes: Process, timeout_s: float = 60.0) -> None:
    """Wait until a subscriber has got so many."""
    eventually(
        lambda: len(lines(file)) >= count,
        timeout_s,
        lambda: '\n'.join([f'{len(lines(file))} of {count}', *(p.output() for p in processes)]),
    )


def wait_for_all(file: Path, count: int, *processes: Process, timeout_s: float = 60.0) -> None:
    """Wait for the last number; what came twice makes a file longer, not complete."""
    last = str(count - 1)
    eventually(
        lambda: last in lines(file)[-1:],
        timeout_s,
        lambda: '\n'.join([f'{lines(file)[-1:]} of {last}', *(p.output() for p in processes)]),
    )


def wait_until_lost(bridge: Process, topic: str) -> None:
    """Wait until a bridge has no partitions any more, in an outage.

    They are lost, or the client is replaced that had them: as a broker goes down in order, it may
    forget all brokers (librdkafka's issue 5301).
    """
    signs = (f'lost {topic}[', 'the Kafka client has forgotten all brokers')
    eventually(lambda: any(sign in bridge.output() for sign in signs), 60, bridge.output)


def steps_back(found: list[int]) -> list[tuple[int, int]]:
    """Where repeats begin, as (number before, number after); between them nothing is left out.

    That is 'in order but for repeats': a step forward is a step by one.
    """
    pairs = list(pairwise(found))
    assert [(a, b) for a, b in pairs if b > a + 1] == []
    return [(a, b) for a, b in pairs if b <= a]


def one_dies_and_the_next_gets_the_rest(
    bench: Bench, topic: str, leave: Leave, full: str = '', **more: Any
) -> Process:
    """A subscriber is killed when it has 1000 of 3000; returns the bridge, which has drained.

    Lost is at most what the dead subscriber's own DDS cache held, acknowledged but not read.

    Args:
        bench: Where they run.
        topic: In Kafka.
        leave: Of the first subscriber.
        full: What the bridge says before the kill, once no more fits into its window.
        more: For the first subscriber.
    """
    count, first, second = 3000, bench.place / 'first', bench.place / 'second'
    config = bench.config([to_ros(topic, ROS_TOPIC)], kafka=bench.patient_kafka)
    bench.produce(topic, numbered(count))
    with (
        bench.subscriber(ROS_TOPIC, first, *leave.options, samples=SAMPLES, **more) as dying,
        bench.bridge(config) as bridge,
    ):
        leave.up_to(1000)
        wait_for_lines(first, 1000, bridge)
        if full:
            bridge.wait_for(full)
        dying.kill()
        with bench.subscriber(ROS_TOPIC, second):
            wait_for_all(second, count, bridge)
            assert bridge.end() == 0
    assert 'a subscriber of /numbers has gone: ' in bridge.output()
    assert totals(bridge)['confirmed'] == count
    assert numbers(first) == list(range(1000))
    after = numbers(second)
    steps_back(after)
    assert min(after) <= 1000 + SAMPLES
    return bridge
