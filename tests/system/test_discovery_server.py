"""A bridge whose nodes meet by a discovery server of Fast DDS.

A client of it is told only of topics on which it has an endpoint itself; a super client of all.
"""

import socket
from collections.abc import Iterator
from typing import Any

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.processes.harness import Bench, eventually
from support.said import row

CURE = 'set ROS_SUPER_CLIENT=TRUE to be told of all'
SUPER = {'ROS_SUPER_CLIENT': 'TRUE'}
COUNT = 200


@pytest.fixture
def client(bench: Bench) -> Iterator[dict[str, Any]]:
    """The environment of a client of a server that runs."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    with bench.script('discovery_server.py', str(port)) as server:
        server.wait_for('ready')
        yield {'ROS_DISCOVERY_SERVER': f'127.0.0.1:{port}', 'ROS_SUPER_CLIENT': ''}


def test_what_a_client_cannot_see_is_said_by_the_route_and_by_every_command(
    bench: Bench, topic_name: str, client: dict[str, Any]
) -> None:
    typed, untyped = f'{topic_name}.typed', f'{topic_name}.untyped'
    bench.create_topic(typed, untyped)
    route = to_kafka('/status', untyped, 'untyped')
    del route['from']['type']
    file = bench.config([route])
    back, there = to_ros(typed, '/back'), bench.place / 'there'
    other = bench.config([to_kafka('/orders', typed, 'typed'), back], name=topic_name)
    with (
        bench.bridge(file, **client) as bridge,
        bench.publisher('/status', '--count', '1', '--readers', '0', **client) as status,
        bench.publisher('/orders', '--count', str(COUNT), **client),
        bench.subscriber('/back', there, **client),
        bench.bridge(other, **client) as carries,
    ):
        status.wait_for('published')
        said = 'untyped: waits for a publisher of /status to learn its type from'
        bridge.wait_for(said)
        [line] = [line for line in bridge.output().splitlines() if said in line]
        assert f'{CURE}, or write from.type' in line
        bridge.wait_for('untyped: starting (waits for a publisher of /status')
        assert len(values(bench.records(typed, COUNT))) == COUNT, 'a route of a type works'
        eventually(lambda: len(lines(there)) >= COUNT, 60, carries.output)
        _, checked, _ = bench.command('check', str(file), '--connect', **client)
        _, seen, _ = bench.command('topics', str(file), **client)
        ended, _, written = bench.command(
            'init', str(bench.place / 'new.yaml'), '--from-graph', **client
        )
        assert carries.end() == bridge.end() == 0
    for text in (checked, seen, written):
        assert CURE in text
        assert 'nobody' not in text
    assert ended == 1
    assert 'which waits to learn its type; set from.type' in checked


def test_a_super_client_learns_types_and_sees_all(
    bench: Bench, topic: str, client: dict[str, Any]
) -> None:
    route = to_kafka('/status', topic)
    del route['from']['type']
    file = bench.config([route])
    with (
        bench.drained(file, **client | SUPER) as bridge,
        bench.publisher('/status', '--count', str(COUNT), **client),
    ):
        assert len(values(bench.records(topic, COUNT))) == COUNT
        _, checked, _ = bench.command('check', str(file), '--connect', **client | SUPER)
        _, seen, _ = bench.command('topics', str(file), **client | SUPER)
    assert 'ROS_SUPER_CLIENT' not in bridge.output() + checked + seen
    assert row(seen, '/status').startswith('/status std_msgs/msg/String 1 reliable, volatile')
    assert 'publishes reliable, volatile' in checked
