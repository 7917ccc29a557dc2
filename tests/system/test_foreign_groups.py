"""A group that is another application's: its members are named, and what to do."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from confluent_kafka import Consumer
from support.bridges.routes import to_ros
from support.monitoring.scrapes import watched
from support.processes.harness import Bench, eventually


@contextlib.contextmanager
def application(bench: Bench, source: dict[str, str], strategy: str) -> Iterator[None]:
    """A consumer of somebody else, in its group."""
    reader = Consumer(
        {
            'bootstrap.servers': bench.bootstrap_servers,
            'group.id': source['group'],
            'client.id': 'shop',
            'partition.assignment.strategy': strategy,
        }
    )
    reader.subscribe([source['kafka']])

    def has_joined() -> bool:
        reader.poll(0.1)
        return bool(reader.assignment())

    with contextlib.closing(reader):
        eventually(has_joined, 60)
        yield


@pytest.fixture
def shared(bench: Bench, unique: Callable[[str], str]) -> dict[str, Any]:
    """A route in the group of somebody else."""
    topic = unique('orders')
    bench.create_topic(topic)
    route = to_ros(topic, '/orders')
    route['from']['group'] = unique('shop')
    return route


def checked(bench: Bench, route: dict[str, Any]) -> str:
    _, out, _ = bench.command('check', '--connect', str(bench.config([route])))
    return ' '.join(out.split())


def test_the_group_of_an_application_that_uses_range_is_named(
    bench: Bench, shared: dict[str, Any]
) -> None:
    with application(bench, shared['from'], 'range'):
        said = checked(bench, shared)
        assert f'note group {shared["from"]["group"]} has members of another' in said
        assert 'application (shop), which share its partitions by range' in said
        assert 'give this route a group of its own' in said
        bridge = watched(bench, [shared])
        with bridge.process as process:
            process.wait_for(
                'Inconsistent group protocol; the group is that of another application'
            )
            bridge.becomes('livez', 200)

            def says_so() -> bool:
                route = bridge.route('to_ros')
                assert route['lag'] is None
                return 'give this route a group of its own' in route['reason']

            eventually(says_so, 60, process.output)


def test_one_that_would_get_a_part_of_the_records_is_named_in_check(
    bench: Bench, shared: dict[str, Any]
) -> None:
    with application(bench, shared['from'], 'cooperative-sticky'):
        assert 'this bridge gets a part of the records' in checked(bench, shared)
