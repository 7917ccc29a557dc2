"""The user's own DDS profile, as Fast DDS itself takes it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.bridges.routes import values
from support.monitoring.scrapes import Watched, settings
from support.processes.harness import Bench, eventually
from support.ros.raw import publish, route, text

from ros2_kafka_bridge.testing.local_kafka import free_port

PUBLIC = """\
<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="mine" is_default_profile="true">
    <rtps><{tag}>robot</{tag}></rtps>
  </participant>
</profiles>
"""


def profile(place: Path, tag: str) -> str:
    file = place / 'profile.xml'
    file.write_text(PUBLIC.format(tag=tag))
    return str(file)


def test_a_profile_of_the_namespace_of_most_public_files_counts(
    bench: Bench, topic_name: str
) -> None:
    """Also for the page and the ROS node of the bridge, which are in one process."""
    port = free_port()
    monitoring = settings(port, node=True)
    routes = [route('/orders', topic_name, None, 'orders')]
    config = bench.config(routes, monitoring=monitoring)
    file = profile(bench.place, 'name')
    with (
        bench.drained(config, FASTDDS_DEFAULT_PROFILES_FILE=file) as bridge,
        publish(bench, '/orders', [text(b'a')], '--durability', 'transient_local'),
    ):
        assert values(bench.records(topic_name, 1)) == [text(b'a')]
        graph = Watched(bridge, port, config)
        eventually(lambda: bench.node in graph.get('api/graph').text, 60, bridge.output)
        eventually(lambda: '/orders' in graph.get('api/graph').text, 60, bridge.output)
    assert 'XMLPARSER' not in bridge.output()
    assert 'does not bound' not in bridge.output()
    assert 'cannot run' not in bridge.output()


@pytest.mark.parametrize('workers', [1, 2])
def test_guarantee_4_nothing_runs_without_the_settings_of_the_bridge(
    bench: Bench, unique: Callable[[str], str], workers: int
) -> None:
    """Fast DDS refuses a file as a whole, and goes on with its defaults."""
    routes = [route(f'/{n}', unique(n), None, n) for n in ('a', 'b')]
    config = bench.config(routes, workers=workers)
    file = profile(bench.place, 'nome')
    with bench.bridge(config, FASTDDS_DEFAULT_PROFILES_FILE=file) as bridge:
        assert bridge.wait() == 2
    said = bridge.output()
    assert f'{file}: Fast DDS refuses this DDS profile' in said
    assert "Invalid element found into 'rtpsParticipantAttributesType'. Name: nome" in said
    assert 'subscribes' not in said
    assert 'Traceback' not in said
