"""Who takes part in the benchmarks, and how each is started.

All get the same ends: `Ends` names the broker, the two Kafka topics and the ROS topic between
them. Everyone is two processes, one for each direction.
"""

import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

_HERE: Final = Path(__file__).parent

BRIDGE_FILE: Final = """\
name: drain
kafka:
  bootstrap.servers: {bootstrap_servers}
routes:
  - name: kafka_to_ros
    from: {{kafka: {source}, start: earliest}}
    to: {{ros: {ros_topic}, type: std_msgs/msg/String{qos}}}
    format: text
  - name: ros_to_kafka
    from: {{ros: {ros_topic}, type: std_msgs/msg/String{qos}}}
    to: {{kafka: {sink}}}
    format: text
"""


class Ends(NamedTuple):
    """What a contestant joins: Kafka topic -> ROS topic -> Kafka topic.

    Args:
        place: A directory of its own, for its files.
    """

    bootstrap_servers: str
    source: str
    ros_topic: str
    sink: str
    place: Path


class Commands(NamedTuple):
    """How the two processes are started.

    Args:
        subscribed: What `ros_to_kafka` prints when it has made its subscription.
        pages: What is asked for each second while they run.
    """

    kafka_to_ros: list[str]
    ros_to_kafka: list[str]
    subscribed: str
    pages: tuple[str, ...] = ()


class Contestant(NamedTuple):
    """One way to move the orders."""

    what: str
    commands: Callable[[Ends], Commands]


def bridge(depth: int | None = None) -> Contestant:
    """This bridge, with default settings or with KEEP_LAST at both ends."""
    qos = '' if depth is None else f', qos: {{history: keep_last, depth: {depth}}}'

    def commands(ends: Ends) -> Commands:
        file = ends.place / 'bridge.yaml'
        file.write_text(BRIDGE_FILE.format(**ends._asdict(), qos=qos), encoding='utf-8')
        run = [sys.executable, '-m', 'ros2_kafka_bridge.process.start', str(file), '--routes']
        return Commands([*run, 'kafka_to_ros'], [*run, 'ros_to_kafka'], 'subscribes to')

    words = 'default settings' if depth is None else f'KEEP_LAST {depth}'
    return Contestant(f'this bridge, {words}', commands)


def monitored() -> Contestant:
    """This bridge with metrics, health, page and node, each direction beside a monitor."""

    def commands(ends: Ends) -> Commands:
        one, two = (f'127.0.0.1:{_free_port()}' for _ in range(2))
        pages = (f'http://{one}/metrics', f'http://{two}/metrics')
        return Commands(
            _run(ends, 'kafka_to_ros', one),
            _run(ends, 'ros_to_kafka', two),
            'subscribes to',
            pages,
        )

    def _run(ends: Ends, route: str, address: str) -> list[str]:
        text = BRIDGE_FILE.format(**ends._asdict(), qos='')
        file = ends.place / f'{route}.yaml'
        file.write_text(f'{text}monitoring: {{listen: {address}}}\n', encoding='utf-8')
        return [sys.executable, '-m', 'ros2_kafka_bridge', 'run', str(file), '--routes', route]

    return Contestant('this bridge, with monitoring', commands)


def _free_port() -> int:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port: int = server.getsockname()[1]
        return port


def paper(depth: int, *of_ros_kafka: str) -> Contestant:
    """The two published algorithms; more options are those of its ros-kafka node."""
    options = ['--depth', str(depth)]
    return Contestant(
        f'the two published algorithms, depth {depth}',
        _both(
            ['-m', f'{__name__}.paper_kafka_ros', *options],
            ['-m', f'{__name__}.paper_ros_kafka', *options, *of_ros_kafka],
        ),
    )


def bare(*of_ros_kafka: str) -> Contestant:
    """Loops that move bytes and confirm nothing: the limit."""
    return Contestant(
        'loops that confirm nothing',
        _both(
            ['-m', f'{__name__}.bare_kafka_ros'],
            ['-m', f'{__name__}.bare_ros_kafka', *of_ros_kafka],
        ),
    )


def native() -> Contestant:
    """Loops in C, where a compiler is there: what is left without Python."""

    def commands(ends: Ends) -> Commands:
        loops = ends.place / 'native.so'
        compiler = ['cc', '-O2', '-fPIC', '-shared', '-o', str(loops)]
        subprocess.run([*compiler, str(_HERE / 'native.c')], check=True)
        program = [str(_HERE / 'native.py'), str(loops)]
        return _both([*program, 'kafka_to_ros'], [*program, 'ros_to_kafka'])(ends)

    return Contestant('loops in C', commands)


def _both(kafka_ros: list[str], ros_kafka: list[str]) -> Callable[[Ends], Commands]:
    def commands(ends: Ends) -> Commands:
        def node(program: list[str], kafka_topic: str) -> list[str]:
            return [sys.executable, *program, ends.bootstrap_servers, kafka_topic, ends.ros_topic]

        return Commands(node(kafka_ros, ends.source), node(ros_kafka, ends.sink), 'subscribed')

    return commands


CONTESTANTS: Final[Mapping[str, Contestant]] = MappingProxyType(
    {
        'paper': paper(10),
        'bridge': bridge(),
        'bare': bare(),
        'native': native(),
        'monitored': monitored(),
    }
)
