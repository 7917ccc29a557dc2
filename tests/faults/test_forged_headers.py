"""What others write proves nothing (guarantee 6b): kills, disks, take-overs, transports."""

import re
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from confluent_kafka import Message, Producer
from support.bridges.numbers_to_kafka import LATCHED
from support.bridges.routes import to_kafka, totals, values
from support.bridges.spooled import arrived, file, on_disk, route
from support.bridges.taking_turns import STANDS_BY, TAKES, exclusive
from support.kafka.forgery import copied, forge, true_ones
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave
from support.spools.files import newest_on_disk

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

if TYPE_CHECKING:
    from ros2_kafka_bridge.endpoints import HeaderList


def wait_for(bench: Bench, topic: str, count: int, *bridges: Process) -> list[Message]:
    """Wait until so many true records are there, and return them."""

    def said() -> str:
        return '\n'.join(bridge.output() for bridge in bridges)

    eventually(lambda: len(true_ones(bench, topic)) >= count, 60, said)
    return true_ones(bench, topic)


@pytest.mark.kills_kafka
def test_guarantee_6b_forged_numbers_delete_nothing_from_the_disk_of_a_killed_bridge(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    bench, leave = own_bench, Leave(own_bench.place)
    config = bench.config([route(bench, own_topic)])
    with bench.publisher('/orders', *leave.options, '--count', '25'):
        with bench.bridge(config) as bridge:
            leave.up_to(5)
            eventually(lambda: arrived(bench, own_topic) == 5, 60, bridge.output)
            own_kafka.kill()
            leave.up_to(25)
            eventually(lambda: newest_on_disk(file(bench)) == 25, 60, bridge.output)
            bridge.kill()
        own_kafka.start()
        last = bench.records(own_topic, 5)[-1]
        forge(bench, own_topic, last, range(1, 41))
        with bench.drained(config) as bridge:
            records = wait_for(bench, own_topic, 25, bridge)
            eventually(lambda: on_disk(bench) == 0, 60, bridge.output)
    found = [int(value) for value in values(records)]
    assert list(dict.fromkeys(found)) == list(range(25))
    assert totals(bridge, 'to_kafka')['sent though their number is there'] > 0


def test_guarantee_6b_headers_of_a_megabyte_cost_a_start_no_memory_without_a_bound(
    bench: Bench, topic: str
) -> None:
    """Well packed they are small on the broker, and more than a gigabyte where they are read."""
    config = bench.config([to_kafka('/orders', topic)])
    gid = bytes(range(16)).hex().encode() * 28_125
    hostile = {'bootstrap.servers': bench.bootstrap_servers, 'compression.type': 'zstd'}
    with Producer(hostile) as producer:
        for seq in range(2000):
            while len(producer) > 50:
                producer.poll(0.01)
            headers: HeaderList = [('ros.gid', gid), ('ros.seq', b'%d' % seq)]
            producer.produce(topic, b'forged', headers=headers)
        assert producer.flush(60) == 0
    with bench.publisher('/orders', *LATCHED, '--count', '10'), bench.drained(config) as bridge:
        eventually(lambda: bench.reaches(topic, 2010), 150, bridge.output)
        status = Path(f'/proc/{bridge.pid}/status').read_text()
    [peak_kb] = re.findall(r'VmHWM:\s+(\d+) kB', status)
    assert int(peak_kb) < 900_000


@pytest.fixture
def name(unique: Callable[[str], str]) -> str:
    """The name of the bridges of a test: those of one name take turns."""
    return unique('pair')


def test_guarantee_6b_forged_numbers_cost_nothing_at_a_take_over(
    bench: Bench, leave: Leave, topic_name: str, name: str
) -> None:
    config = exclusive(bench, name, topic_name)
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES, 60)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY, 60)
        options = (*LATCHED, *leave.options, '--count', '60')
        publisher = stack.enter_context(bench.publisher('/orders', *options))
        leave.up_to(20)
        last = wait_for(bench, topic_name, 20, first)[-1]
        first.kill()
        forge(bench, topic_name, last, range(21, 71))
        leave.up_to(60)
        publisher.wait_for('published')
        second.wait_for(TAKES, 60)
        records = wait_for(bench, topic_name, 60, second)
        assert second.end() == 0
    assert [int(value) for value in values(records)] == list(range(60)), 'each once, in order'


def test_guarantee_6b_what_a_job_has_copied_from_the_topic_of_another_route_is_not_skipped(
    bench: Bench, topic_name: str
) -> None:
    """Two routes of one latched publisher; the second one comes later, and finds the copies."""
    second, leave, count = f'{topic_name}.second', Leave(bench.place), 30
    bench.create_topic(topic_name, second)
    one, other = to_kafka('/orders', topic_name, 'one'), to_kafka('/orders', second, 'other')
    with bench.publisher('/orders', *LATCHED, *leave.options, '--count', str(count + 2)):
        leave.up_to(count)
        with bench.drained(bench.config([one])) as bridge:
            records = wait_for(bench, topic_name, count, bridge)
        for record in records:
            bench.produce(second, [b'copy'], headers=copied(record))
        for run in (1, 2):
            with bench.drained(bench.config([one, other])) as bridge:
                leave.up_to(count + run)
                for topic in (topic_name, second):
                    wait_for(bench, topic, count + run, bridge)
            new = count + 1 if run == 1 else 1
            assert totals(bridge, 'other')['confirmed'] == new, 'rather twice than never'
            assert totals(bridge, 'one')['confirmed'] == 1, 'and only there'
    assert len(true_ones(bench, second)) == count + 2


def test_what_a_bridge_without_the_header_of_its_route_has_written_is_repeated_once(
    bench: Bench, topic_name: str
) -> None:
    """An upgrade: the new bridge does not know the records of the old one for its own."""
    first, leave, count = f'{topic_name}.first', Leave(bench.place), 30
    bench.create_topic(first, topic_name)
    with bench.publisher('/orders', *LATCHED, *leave.options, '--count', str(count + 2)):
        leave.up_to(count)
        with bench.drained(bench.config([to_kafka('/orders', first)])) as bridge:
            for record in wait_for(bench, first, count, bridge):
                old = [one for one in copied(record) if one[0] != 'bridge.route']
                bench.produce(topic_name, [record.value()], headers=old)
        config = bench.config([to_kafka('/orders', topic_name)])
        for run, there in ((1, 2 * count + 1), (2, 2 * count + 2)):
            with bench.drained(config) as bridge:
                leave.up_to(count + run)
                wait_for(bench, topic_name, there, bridge)
    found = [int(value) for value in values(true_ones(bench, topic_name))]
    assert found == [*range(count), *range(count), count, count + 1]


@pytest.mark.parametrize(
    ('vendor', 'transports'), [('fastdds', ('SHM', 'UDPv4', 'SHM')), ('cyclone', ('UDPv4',) * 2)]
)
def test_guarantee_8_a_history_read_over_another_transport_is_known_again(
    bench: Bench, topic: str, vendor: str, transports: tuple[str, ...]
) -> None:
    """Transports and vendors round the time of a message: it is known within a microsecond."""
    count, leave = 500, Leave(bench.place)
    config = bench.config([to_kafka('/orders', topic)])
    options = (*leave.options, '--count', str(count + len(transports)))
    with ExitStack() as stack:
        if vendor == 'fastdds':
            stack.enter_context(bench.publisher('/orders', *LATCHED, *options))
        else:
            words = 'write', '/orders', '--latched', *options
            stack.enter_context(bench.peer('cyclone', *words))
        for run, transport in enumerate(transports):
            with bench.drained(config, FASTDDS_BUILTIN_TRANSPORTS=transport) as bridge:
                leave.up_to(count + run)
                wait_for(bench, topic, count + run, bridge)
            assert totals(bridge, 'to_kafka')['confirmed'] == (1 if run else count)
    records = true_ones(bench, topic)
    assert [int(value) for value in values(records)] == list(range(count + len(transports) - 1))
    assert all(int(headers(record)['ros.source_time_ns']) > 0 for record in records)


def test_guarantee_6b_forged_numbers_cost_a_publisher_without_a_time_nothing(
    bench: Bench, leave: Leave, topic: str
) -> None:
    """A time near 1970 is that of no message: its history comes again, and nothing is skipped."""
    config = bench.config([to_kafka('/orders', topic)])
    options = ('--latched', '--timeless', *leave.options, '--count', '10')
    with bench.peer('cyclone', 'write', '/orders', *options):
        with bench.drained(config) as bridge:
            leave.up_to(5)
            records = wait_for(bench, topic, 5, bridge)
        assert not any('ros.source_time_ns' in headers(record) for record in records)
        told = [one for one in copied(records[-1]) if one[0] != 'ros.seq']
        for seq in range(6, 11):
            for time_ns in (b'1', b'999'):
                own = [('ros.seq', b'%d' % seq), ('ros.source_time_ns', time_ns)]
                bench.produce(topic, [b'forged'], headers=[*told, *own])
        with bench.drained(config) as bridge:
            leave.up_to(10)
            records = wait_for(bench, topic, 15, bridge)
            bridge.wait_for('sends no time with its messages')
    assert [int(value) for value in values(records)] == [*range(5), *range(10)]
