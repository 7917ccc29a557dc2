"""The bridge among nodes whose DDS is of another vendor (Cyclone DDS)."""

import contextlib
import re
import sys
from pathlib import Path

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.processes.harness import Bench, eventually, headers
from support.processes.lifetimes import Leave
from support.processes.terminal import finished

TUNING = Path(__file__).parents[2] / 'docs' / 'tuning.md'
COUNT = 1000
NUMBERS = [str(number) for number in range(COUNT)]


def test_a_writer_of_another_vendor_reaches_kafka_once_and_in_order_guarantees_2_3(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    with (
        bench.drained(config),
        bench.peer('cyclone', 'write', '/orders', '--count', str(COUNT)) as writer,
    ):
        writer.wait_for('published')
        records = bench.records(topic_name, COUNT)
    assert values(records) == [number.encode() for number in NUMBERS]
    found = [headers(record) for record in records]
    assert [header['ros.seq'] for header in found] == [str(n) for n in range(1, COUNT + 1)]
    assert len({header['ros.gid'] for header in found}) == 1


def test_a_reader_of_another_vendor_gets_all_once_and_in_order_guarantees_1_3(
    bench: Bench, topic_name: str
) -> None:
    file = bench.place / 'received'
    config = bench.config([to_ros(topic_name, '/orders')])
    bench.produce(topic_name, [number.encode() for number in NUMBERS])
    with (
        bench.peer('cyclone', 'read', '/orders', '--file', str(file)),
        bench.drained(config) as bridge,
    ):
        eventually(lambda: len(lines(file)) >= COUNT, 60, lambda: f'only {lines(file)} came')
        # Confirmed, too: the other vendor's acknowledgements are understood.
        eventually(lambda: bench.committed(bench.group, topic_name) == COUNT, 60)
    assert lines(file) == NUMBERS
    assert totals(bridge)['confirmed'] == COUNT


def test_readers_of_another_vendor_that_come_after_the_bridge_miss_nothing_guarantee_1(
    bench: Bench, topic_name: str
) -> None:
    """They know of the bridge a second after it knows of them, and more."""
    files = [bench.place / f'received_{number}' for number in range(4)]
    topics = [f'/orders_{number}' for number in range(4)]
    bench.produce(topic_name, [number.encode() for number in NUMBERS])
    config = bench.config([to_ros(topic_name, topic, topic[1:]) for topic in topics])
    with bench.bridge(config) as bridge, contextlib.ExitStack() as stack:
        for topic in topics:
            bridge.wait_for(f'{topic[1:]}: reads {topic_name}')
        for topic, file in zip(topics, files, strict=True):
            stack.enter_context(bench.peer('cyclone', 'read', topic, '--file', str(file)))
        eventually(lambda: all(NUMBERS[-1] in lines(file) for file in files), 60)
        assert bridge.end() == 0
    assert [lines(file) for file in files] == [NUMBERS] * 4


def test_the_history_of_a_writer_of_another_vendor_is_known_again_guarantee_8(
    bench: Bench, topic_name: str
) -> None:
    """It sends it to a volatile subscription, too: to the first one, before it is known."""
    count, restarts, leave = 200, 6, Leave(bench.place)
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--latched', *leave.options, '--count', str(count + restarts))
    with bench.peer('cyclone', 'write', '/orders', *options):
        for run in range(restarts):
            with bench.drained(config) as bridge:
                leave.up_to(count + run)
                bench.records(topic_name, count + run)
            assert totals(bridge, 'to_kafka')['confirmed'] == (1 if run else count)


def test_large_messages_of_a_writer_of_another_vendor_come_whole(
    bench: Bench, topic_name: str
) -> None:
    """As many packets at once as no socket holds: what does not fit is sent again."""
    count, size = 50, 900_000
    config = bench.config([to_kafka('/orders', topic_name)])
    options = ('--count', str(count), '--bytes', str(size))
    with (
        bench.drained(config),
        bench.peer('cyclone', 'write', '/orders', *options) as writer,
    ):
        writer.wait_for('published', 90)
        records = bench.records(topic_name, count)
    assert values(records) == [str(number).ljust(size, '.').encode() for number in range(count)]


def test_the_sockets_hold_what_the_profile_of_the_docs_asks_for(bench: Bench) -> None:
    if int(Path('/proc/sys/net/core/rmem_max').read_text()) < 4_194_304:
        pytest.skip('Linux grants no socket so much here: net.core.rmem_max')
    [xml] = re.findall(r'```xml\n(.*?receiveBufferSize.*?)```', TUNING.read_text(), re.DOTALL)
    profile = bench.place / 'large.xml'
    profile.write_text(xml)
    file = bench.config([to_kafka('/orders', 'orders', max_message_bytes=2_000_000)])
    for environ, said in ({}, 1), ({'FASTDDS_DEFAULT_PROFILES_FILE': str(profile)}, 0):
        asked = finished(
            [sys.executable, '-m', 'ros2_kafka_bridge', 'check', str(file), '--connect'],
            env={**bench.environ, **environ},
        )
        assert asked.stdout.count('a UDP socket of DDS holds') == said, asked.stdout
