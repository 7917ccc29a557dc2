"""How many messages DDS keeps for a route, and how much memory that may take in all."""

import logging
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import pytest

from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.kafka.properties import prefetch_bytes
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.ros.discovery import ANNOUNCED_S
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.message_sizes import described_sizes, histories_of, message_sizes
from ros2_kafka_bridge.ros.probe import SAMPLES
from ros2_kafka_bridge.route.memory import Kept, in_words, most_memory, take_bytes
from ros2_kafka_bridge.threads.stop import Stop

IMAGE = 'sensor_msgs/msg/Image'
TWIST = 'geometry_msgs/msg/Twist'
STRING = 'std_msgs/msg/String'
MIB = 1 << 20
ROOT = Path(__file__).parents[3]
PREFETCH_BYTES = 8 * MIB
KEEP_LAST = {'qos': {'history': 'keep_last', 'depth': 100}}


def from_ros(message_type: str | None = IMAGE, name: str = 'r', **more: Any) -> RosToKafkaRoute:
    source = {'ros': '/a', 'type': message_type} | more.pop('source', {})
    given = {'name': name, 'from': source, 'to': {'kafka': 'a'}, 'format': 'cdr', **more}
    return validated(RosToKafkaRoute, given)


def to_ros(message_type: str = IMAGE, name: str = 'r', **more: Any) -> KafkaToRosRoute:
    sink = {'ros': '/b', 'type': message_type} | more.pop('sink', {})
    given = {'name': name, 'from': {'kafka': 'a'}, 'to': sink} | {'format': 'cdr'} | more
    return validated(KafkaToRosRoute, given)


def with_routes(*routes: AnyRoute) -> Config:
    return replace(validated(Config, FILE), routes=[*routes])


def seen_from(domain: int) -> Config:
    """A route whose type nobody names, in a ROS domain."""
    ros = replace(validated(Config, FILE).ros, domain_id=domain)
    return replace(with_routes(from_ros(None)), ros=ros)


def samples_of(route: AnyRoute) -> int:
    """How many messages DDS keeps for a route of a type that is installed here."""
    return route.ros_history(described_sizes(with_routes(route))[route.name])


FILE: dict[str, Any] = {
    'name': 'b', 'kafka': {'bootstrap.servers': 'localhost:9092'},
    'routes': [{'name': 'r', 'from': {'ros': '/a'}, 'to': {'kafka': 'a'}, 'format': 'cdr'}],
}  # fmt: skip


@pytest.mark.parametrize(
    ('route', 'samples'),
    [
        (from_ros(), 67),
        (from_ros(max_message_bytes=6_000_000), 11),
        (from_ros(max_cache_bytes=16 * MIB), 16),
        (from_ros(max_message_bytes=100_000_000), 1),
        (from_ros(max_message_bytes=1000), 2000),
        (from_ros('nav_msgs/msg/OccupancyGrid'), 67),
        (from_ros(TWIST), 2000),
        (from_ros(TWIST, max_cache_bytes=5200), 100),
        (from_ros(STRING), 2000),
        (from_ros(source={'max_samples': 300}), 300),
        (from_ros(source={'max_samples': 300}, max_cache_bytes=1), 300),
        (from_ros(source=KEEP_LAST), 100),
        (from_ros(source=KEEP_LAST | {'max_samples': 50}), 100),
        (to_ros(sink=KEEP_LAST), 500),
        (to_ros(sink=KEEP_LAST, max_in_flight=30), 100),
        (to_ros(), 67),
        (to_ros(STRING), 500),
        (to_ros(TWIST, max_in_flight=30), 30),
    ],
)
def test_dds_keeps_what_fits_as_far_as_the_type_says_how_large_messages_are(
    route: AnyRoute, samples: int
) -> None:
    assert samples_of(route) == samples


def test_of_a_type_that_nobody_here_knows_as_many_are_kept_as_of_small_ones() -> None:
    route = from_ros(None)
    assert described_sizes(with_routes(route, from_ros('acme/msg/Map', name='map'))) == {}
    assert route.ros_history(None) == 2000


def test_the_profile_has_the_longest_of_the_histories_of_a_topic() -> None:
    routes: list[AnyRoute] = [
        from_ros(name='x'), from_ros(name='y', max_cache_bytes=16 * MIB), to_ros(name='z'),
    ]  # fmt: skip
    sizes = described_sizes(with_routes(*routes))
    probed = {'/probed': SAMPLES}
    found = histories_of(routes, sizes, '/probed', 3.0)
    assert found == Histories({**probed, '/b': 67}, {**probed, '/a': 67}, 3.0)


def test_nobody_looks_at_the_graph_where_the_file_says_it_all(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.ros.message_sizes.ask', None)
    config = with_routes(from_ros(name='x'), from_ros(None, name='y', source={'max_samples': 5}))
    sizes = {'x': 1_000_000, 'y': 1_000_000}
    assert message_sizes(config, config.routes, 'b', Stop(), route_log()) == sizes
    assert caplog.messages == []


def test_what_a_route_of_the_file_publishes_has_the_type_that_it_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As the routes of the README, there and back: nobody has to be waited for."""
    monkeypatch.setattr('ros2_kafka_bridge.ros.message_sizes.ask', None)
    config = load(ROOT / 'examples/bridge.yaml', {})
    back = [route for route in config.routes if route.type_name is None]
    sizes = message_sizes(config, back, 'b', Stop(), route_log())
    assert back
    assert {route.name for route in config.routes} == sizes.keys()


def test_a_stop_ends_the_look_at_the_graph(ros_domain: int) -> None:
    stop, config = Stop(), seen_from(ros_domain)
    stop.ask()
    since_s = time.monotonic()
    assert message_sizes(config, config.routes, 'b', stop, route_log()) == {}
    assert time.monotonic() - since_s < ANNOUNCED_S


def test_whoever_interrupts_the_look_leaves_no_process_behind(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = seen_from(ros_domain)
    started: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def start(*given: Any, **more: Any) -> subprocess.Popen[bytes]:
        started.append(popen(*given, **more))
        return started[-1]

    class Interrupted(Stop):
        @property
        def asked(self) -> bool:
            raise KeyboardInterrupt

    monkeypatch.setattr('subprocess.Popen', start)
    with pytest.raises(KeyboardInterrupt):
        message_sizes(config, config.routes, 'b', Interrupted(), route_log())
    assert [one.returncode for one in started] == [-signal.SIGKILL]


def test_a_look_that_cannot_be_begun_is_said_and_ends_nothing(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    config = seen_from(ros_domain)
    monkeypatch.setattr('sys.executable', None)
    assert message_sizes(config, config.routes, 'b', Stop(), route_log()) == {}
    monkeypatch.setattr('sys.executable', '/bin/false')
    assert message_sizes(config, config.routes, 'b', Stop(), route_log()) == {}
    said = [line for line in caplog.messages if 'cannot look who is there' in line]
    assert len(said) == 2
    assert 'DDS keeps as many as of small ones' in caplog.messages[-1]


def test_without_ros_it_says_so_and_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    config = with_routes(from_ros(None))
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    with pytest.raises(ConfigError, match='ROS 2 is not here'):
        message_sizes(config, config.routes, 'b', Stop(), route_log())


def test_what_a_route_takes_at_most_is_all_that_waits() -> None:
    route, kept = from_ros(), Kept(67, 1_000_000)
    window, take = 16 * MIB, 4 * MIB
    assert take_bytes(route) == take
    waits = 67_000_000 + window + 2 * (take + 1_000_000) + window
    assert most_memory(route, kept, PREFETCH_BYTES) == waits
    read = PREFETCH_BYTES + MIB
    waits = 67_000_000 + 2 * read + window + window
    assert most_memory(to_ros(), kept, PREFETCH_BYTES) == waits


@pytest.mark.parametrize('make', [from_ros, to_ros])
def test_where_the_oldest_are_dropped_as_much_waits_as_the_sink_has(make: Any) -> None:
    kept = Kept(67, 1_000_000)

    def most(**more: Any) -> int:
        return most_memory(make(**more), kept, PREFETCH_BYTES)

    assert most(when_full='drop_oldest') == most() + 16 * MIB
    larger = {'max_message_bytes': 60_000_000}  # one that is with the sink, and one that waits
    assert most(when_full='drop_oldest', **larger) == most(**larger) - 16 * MIB + 2 * 60_000_000


def test_a_record_that_becomes_a_larger_message_counts_with_that() -> None:
    kept, read = Kept(500, 800_004), PREFETCH_BYTES + MIB
    waits = 500 * 800_004 + read + 50 * 800_004 + 2 * 16 * MIB
    assert most_memory(to_ros(format='json'), kept, PREFETCH_BYTES) == waits


@pytest.mark.parametrize(
    ('kbytes', 'size_bytes'), [('100', 102_400), (' 100 ', 102_400), ('x', 8 * MIB)]
)
def test_what_a_consumer_reads_ahead_is_what_the_file_says(kbytes: str, size_bytes: int) -> None:
    assert prefetch_bytes({}) == 8 * MIB
    assert prefetch_bytes({'queued.max.messages.kbytes': kbytes}) == size_bytes


def test_a_small_window_has_a_small_take() -> None:
    assert take_bytes(from_ros(max_in_flight_bytes=10_000)) == 10_000


SAID: Final = (
    (from_ros(), Kept(67, 1_000_000), """
        111 MB of memory: DDS keeps 67 messages (max_cache_bytes) of up to 1,000,000 bytes"""),
    (from_ros(), Kept(2000, 1_000_000), """
        2,044 MB of memory: DDS keeps 2,000 messages (max_samples) of up to 1,000,000 bytes"""),
    (from_ros(STRING), Kept(2000, None), """
        2,044 MB of memory, if each of the 2,000 messages (max_samples) that DDS keeps had
        1,000,000 bytes (max_message_bytes)"""),
    (from_ros(max_cache_bytes=16 * MIB), Kept(67, 1_000_000), """
        111 MB of memory: DDS keeps 67 messages (more than this route needs) of up to
        1,000,000 bytes"""),
    (from_ros(source=KEEP_LAST), Kept(100, 1_000_000), """
        144 MB of memory: DDS keeps 100 messages (depth) of up to 1,000,000 bytes"""),
    (to_ros(TWIST), Kept(500, 52), """
        53 MB of memory: DDS keeps 500 messages (max_in_flight) of up to 52 bytes"""),
)  # fmt: skip


@pytest.mark.parametrize(('route', 'kept', 'words'), SAID)
def test_it_is_said_with_what_bounds_it(route: AnyRoute, kept: Kept, words: str) -> None:
    told = in_words(route, kept, PREFETCH_BYTES)
    assert told == ' '.join(f'at most {words}'.split())
