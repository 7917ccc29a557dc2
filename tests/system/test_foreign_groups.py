"""A group that is another application's: its members are named, and what to do."""

import contextlib
from collections.abc import Callable, Iterator

from confluent_kafka import Consumer
from harness import Bench, eventually, to_ros
from scrapes import watched


@contextlib.contextmanager
def application(bench: Bench, group: str, topic: str, strategy: str) -> Iterator[None]:
    """A consumer of somebody else, in its group."""
    reader = Consumer(
        {
            'bootstrap.servers': bench.bootstrap_servers,
            'group.id': group,
            'client.id': 'shop',
            'partition.assignment.strategy': strategy,
        }
    )
    reader.subscribe([topic])

    def has_joined() -> bool:
        reader.poll(0.1)
        return bool(reader.assignment())

    with contextlib.closing(reader):
        eventually(has_joined, 60)
        yield


def test_the_group_of_an_application_that_uses_range_is_named(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    topic, group = unique('orders'), unique('shop')
    bench.create_topic(topic)
    route = to_ros(topic, '/orders')
    route['from']['group'] = group
    with application(bench, group, topic, 'range'):
        _, out, _ = bench.command('check', '--connect', str(bench.config([route])))
        said = ' '.join(out.split())
        assert f'note group {group} has members of another application (shop), which' in said
        assert 'give this route a group of its own' in said
        bridge = watched(bench, [route])
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
    bench: Bench, unique: Callable[[str], str]
) -> None:
    topic, group = unique('orders'), unique('shop')
    bench.create_topic(topic)
    route = to_ros(topic, '/orders')
    route['from']['group'] = group
    with application(bench, group, topic, 'cooperative-sticky'):
        _, out, _ = bench.command('check', '--connect', str(bench.config([route])))
        assert 'this bridge gets a part of the records' in ' '.join(out.split())
