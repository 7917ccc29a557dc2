"""The network between hosts is cut, or loses packets, while numbers cross it both ways.

Three hosts: the robot with the nodes, the edge with the bridge, the site with Kafka. Each is a
network of its own in the kernel, which takes root. What is cut off is silent, not refused.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from support.bridges.numbers_to_ros import numbered, numbers, steps_back
from support.bridges.routes import lines, to_kafka, to_ros, totals, values
from support.kafka.paced import Stream
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave

from rig.hosts import Hosts, Network
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

DOWN = '/down'  # Kafka -> ROS
UP = '/up'  # ROS -> Kafka
RATE = 120.0
COUNT = 2400


@pytest.fixture(scope='module')
def hosts() -> Iterator[Hosts]:
    """Three hosts, for all tests that leave them joined."""
    with ExitStack() as stack:
        try:
            joined = stack.enter_context(Network(*Hosts._fields))
        except ConfigError as reason:
            pytest.skip(str(reason))
        yield Hosts(*joined)


@pytest.fixture(scope='module')
def site_kafka(hosts: Hosts) -> Iterator[LocalKafka]:
    """A real Kafka at the site."""
    node = LocalKafka(host=hosts.site.address)
    with hosts.site.entered():
        node.start()
    yield node
    node.stop()


@pytest.fixture
def site(tmp_path: Path, hosts: Hosts, site_kafka: LocalKafka, ros_domain: int) -> Iterator[Bench]:
    """A bench at the site, where the test itself is, too."""
    with hosts.site.entered():
        yield Bench(tmp_path, site_kafka.bootstrap_servers, ros_domain).on(hosts.site)
    for host in hosts:
        host.plug_in()
        host.lose(0.0)


class Traffic(NamedTuple):
    """Numbers on their way in both directions."""

    bridge: Process
    down: Path  # what the subscriber has read
    up: Callable[[], int]  # how many records have come
    leave: Leave  # of the publisher

    def wait_for(self, count: int) -> None:
        """Wait until so many have crossed in each direction."""
        eventually(lambda: len(lines(self.down)) >= count, 90, self._what)
        eventually(lambda: self.up() >= count, 90, self._what)

    def wait_for_the_last(self) -> None:
        """Wait for the last number downwards: repeats make a file longer, not complete."""
        last = str(COUNT - 1)
        eventually(lambda: last in lines(self.down)[-1:], 90, self._what)

    def _what(self) -> str:
        return f'{len(lines(self.down))} down, {self.up()} up\n{self.bridge.output()}'


@contextmanager
def traffic(
    site: Bench, hosts: Hosts, topic: str, *, lease_s: float | None = None, session_s: int = 60
) -> Iterator[Traffic]:
    """Numbers through a bridge on the edge, between Kafka at the site and nodes on the robot."""
    robot, edge = site.on(hosts.robot), site.on(hosts.edge)
    down, up = f'{topic}.down', f'{topic}.up'
    site.create_topic(down, up)
    ros = {} if lease_s is None else {'lease_s': lease_s}
    kafka = {**edge.patient_kafka, 'session.timeout.ms': session_s * 1000}
    config = edge.config([to_ros(down, DOWN), to_kafka(UP, up)], ros=ros, kafka=kafka)
    arrived = robot.place / 'arrived'
    leave = Leave(robot.place)
    leave.up_to(100)
    with (
        robot.subscriber(DOWN, arrived, lease_s=lease_s),
        edge.bridge(config) as bridge,
        robot.publisher(UP, '--count', str(COUNT), '--rate', str(RATE), *leave.options),
    ):
        crossing = Traffic(bridge, arrived, lambda: site.end_offset(up), leave)
        eventually(lambda: 'reads ' in bridge.output() and crossing.up() > 0, 90, bridge.output)
        with Stream(site, down, numbered(COUNT), RATE):  # where nothing is cut
            yield crossing
        assert bridge.end() == 0


def in_order_but_for_repeats(found: list[int]) -> list[int]:
    """See that all is there, from 0 on; returns where repeats begin."""
    assert found[0] == 0
    assert found[-1] == COUNT - 1
    return [after for _, after in steps_back(found)]


def assert_once_and_in_order(site: Bench, topic: str, crossing: Traffic) -> None:
    assert numbers(crossing.down) == list(range(COUNT))
    assert_up(site, topic)
    assert totals(crossing.bridge).get('published again', 0) == 0
    for route in ('to_ros', 'to_kafka'):
        assert totals(crossing.bridge, route)['confirmed'] == COUNT


def assert_up(site: Bench, topic: str) -> None:
    records = site.records(f'{topic}.up', COUNT)
    assert values(records) == numbered(COUNT)
    assert [int(headers(record)['ros.seq']) for record in records] == list(range(1, COUNT + 1))


def test_guarantees_1_2_3_nodes_cut_off_for_less_than_their_lease_lose_and_double_nothing(
    site: Bench, hosts: Hosts, topic_name: str
) -> None:
    with traffic(site, hosts, topic_name) as crossing:
        crossing.wait_for(100)
        crossing.leave.set_off(600)
        hosts.robot.unplug()
        out = crossing.leave.out
        eventually(lambda: crossing.leave.out == 600, 60)
        assert crossing.up() <= out + 1, 'it is cut off'  # it says so once it has published
        hosts.robot.plug_in()
        crossing.leave.up_to(COUNT)
        crossing.wait_for(COUNT)
    assert_once_and_in_order(site, topic_name, crossing)


def test_guarantees_1_2_3_a_bridge_cut_off_from_all_loses_nothing_and_repeats_what_is_uncommitted(
    site: Bench, hosts: Hosts, topic_name: str
) -> None:
    """After 6 s its group gives it up, and after 10 s it gives up its connections."""
    with traffic(site, hosts, topic_name, session_s=6) as crossing:
        crossing.wait_for(100)
        crossing.leave.set_off(COUNT)
        hosts.edge.unplug()
        crossing.bridge.wait_for('to_ros: Kafka is away: ', timeout_s=90)
        committed = site.committed(site.group, f'{topic_name}.down')
        hosts.edge.plug_in()
        crossing.wait_for_the_last()
        crossing.wait_for(COUNT)  # what goes up is lost with its publisher after a stop
    found = numbers(crossing.down)
    again = in_order_but_for_repeats(found)
    # What the bridge had asked before the cut may come behind what it asks when it is back: Kafka
    # then takes it for another one, and it joins once more.
    assert len(again) <= 1 + ('Static consumer fenced' in crossing.bridge.output())
    assert all(first >= committed for first in again), 'a commit may still arrive after the cut'
    assert totals(crossing.bridge)['confirmed'] >= COUNT
    assert 'Kafka is back' in crossing.bridge.output()
    assert_up(site, topic_name)


def test_guarantees_1_2_3_lost_packets_lose_and_double_no_message(
    site: Bench, hosts: Hosts, topic_name: str
) -> None:
    try:
        hosts.edge.lose(0.05)  # of DDS and of Kafka alike
    except ConfigError as reason:
        pytest.skip(str(reason))
    with traffic(site, hosts, topic_name) as crossing:
        crossing.leave.up_to(COUNT)
        crossing.wait_for(COUNT)
    assert_once_and_in_order(site, topic_name, crossing)


def test_guarantee_1_a_subscriber_out_of_reach_for_longer_than_its_lease_gets_all_and_some_twice(
    site: Bench, hosts: Hosts, topic_name: str
) -> None:
    """The way up has a VOLATILE publisher, which keeps nothing for a bridge that it gave up."""
    with traffic(site, hosts, topic_name, lease_s=2.0) as crossing:
        crossing.wait_for(100)
        crossing.leave.set_off(COUNT)
        hosts.robot.unplug()
        crossing.bridge.wait_for('a subscriber of /down has gone: ', timeout_s=60)
        hosts.robot.plug_in()
        crossing.wait_for_the_last()
    found = numbers(crossing.down)
    in_order_but_for_repeats(found)
    assert totals(crossing.bridge)['confirmed'] == COUNT
    assert totals(crossing.bridge)['published again'] >= len(found) - COUNT
    records = site.records(f'{topic_name}.up', totals(crossing.bridge, 'to_kafka')['confirmed'])
    seqs = [int(headers(record)['ros.seq']) for record in records]
    assert seqs == sorted(set(seqs))
