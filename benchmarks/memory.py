"""How much memory a bridge takes, and whoever is at the other end of DDS, while one stands still.

    python -m benchmarks.memory

Each situation has a bridge of its own, on a real Kafka, with default settings: its file is
printed. A camera has 30 pictures of 0.92 MB a second, a lidar 10 clouds of 5 MB; they are there
before the bridge, and Kafka is stopped for 60 s. To ROS go 600 pictures, whose reader is stopped
for 15 s. Measured are anonymous memory of the bridge (what no other process shares and no file
backs), by how much that of the ROS node beside it grows, and by how much /dev/shm does.
(PYTHONDONTWRITEBYTECODE must not be set: where Python compiles what it imports, that takes memory,
too.) The bare node has a publisher, a subscription, a consumer and a producer, and moves nothing.
"""

import argparse
import itertools
import os
import shutil
import signal
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from rclpy.serialization import serialize_message
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import Image, PointCloud2

from benchmarks.machine import machine, versions
from benchmarks.processes import programs
from benchmarks.topics import EndOffset, fill, topics
from benchmarks.vitals import sampled, watched
from rig.processes import Process, ProcessError, Programs
from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_bridge.testing.orders import encode, orders

START_S: Final = 60.0
SETTLE_S: Final = 5.0
AWAY_S: Final = 60.0
HUNG_S: Final = 15.0  # less than the lease of the reader: the bridge takes it for dead then
LONGEST_S: Final = 180.0
LOOK_S: Final = 0.05
TOPIC_BYTES: Final = 7_000_000
FOR_EVER: Final = '1000000'  # messages
SHM: Final = '/dev/shm'  # noqa: S108 - looked at
DOMAIN: Final = 214

BACK: Final = """\
  - name: to_ros
    from: {{kafka: {source}}}
    to: {{ros: /orders, type: std_msgs/msg/String}}
    format: text
  - name: to_kafka
    from: {{ros: /orders}}
    to: {{kafka: {sink}}}
    format: text
"""
CAMERA: Final = """\
  - name: camera
    from: {{ros: /camera}}
    to: {{kafka: {sink}}}
    format: cdr
"""
LIDAR: Final = """\
  - name: points
    from: {{ros: /points}}
    to: {{kafka: {sink}}}
    format: cdr
    max_message_bytes: 6000000
"""
SCREEN: Final = """\
  - name: screen
    from: {{kafka: {source}}}
    to: {{ros: /camera, type: sensor_msgs/msg/Image}}
    format: cdr
"""


class Stage(NamedTuple):
    """What a situation works with.

    Args:
        kafka: A broker of its own.
        place: A directory of its own.
        at: Where programs run.
        source: A Kafka topic.
        sink: Another one.
        delivered: How many records that has.
        published: A file with a byte for each message that a publisher has published.
    """

    kafka: LocalKafka
    place: Path
    at: Programs
    source: str
    sink: str
    delivered: EndOffset
    published: Path

    def fill(self, values: Sequence[bytes]) -> None:
        """Produce to the source."""
        fill(self.kafka.bootstrap_servers, self.source, values)

    def wait_for_records(self, count: Callable[[], int]) -> None:
        """Wait until the sink has so many; asked again and again."""
        deadline_s = time.monotonic() + LONGEST_S
        while self.delivered() < count():
            if time.monotonic() > deadline_s:
                raise TimeoutError(f'{self.delivered()} of {count()} messages came through')
            time.sleep(0.2)


class Case(NamedTuple):
    """A situation.

    Args:
        what: In the table.
        routes: Of the file.
        node: Makes the ROS node beside the bridge; None where there is none.
        play: Makes it happen; returns when it is over.
    """

    what: str
    routes: str
    node: Callable[[Stage], Process] | None
    play: Callable[[Stage, Process | None], None]


class Result(NamedTuple):
    """What it took, in MiB; None where there is no node.

    Args:
        what: The situation.
        before: Of the bridge.
        most: Of the bridge.
        after: Of the bridge, five seconds after it was over.
        node: Growth of the node.
        shm: Growth of /dev/shm.
    """

    what: str
    before: float
    most: float
    after: float
    node: float | None
    shm: float

    @property
    def row(self) -> Sequence[str]:
        """A row of the table."""
        sizes = self.before, self.most, self.after, self.node, self.shm
        return self.what, *('' if size is None else f'{size:,.1f}' for size in sizes)


# Who is there


def _publisher(stage: Stage, topic: str, message: Any, rate: int, depth: int) -> Process:
    file = stage.place / 'message'
    file.write_text(serialize_message(message).hex())
    kind = f'sensor_msgs/msg/{type(message).__name__}'
    (leave := stage.published.with_suffix('')).write_text(FOR_EVER)
    words = ('--type', kind, '--file', str(file), '--times', FOR_EVER, '--readers', '0')
    more = ('--rate', str(rate), '--depth', str(depth), '--leave', str(leave))
    return stage.at.peer('publisher', 'publisher', topic, *words, *more)


def _picture() -> Image:
    return Image(height=480, width=640, encoding='rgb8', step=1920, data=bytes(640 * 480 * 3))


def _camera(depth: int, stage: Stage) -> Process:
    return _publisher(stage, '/camera', _picture(), 30, depth)


def _lidar(stage: Stage) -> Process:
    size = 5_000_000
    cloud = PointCloud2(height=1, width=size // 16, point_step=16, row_step=size, data=bytes(size))
    return _publisher(stage, '/points', cloud, 10, 10)


def _screen(stage: Stage) -> Process:
    words = ('/camera', os.devnull, '--type', 'sensor_msgs/msg/Image', '--form', 'hash')
    return stage.at.peer('subscriber', 'subscriber', *words, '--depth', '10')


# What happens


def _idle(_stage: Stage, _node: Process | None) -> None:
    time.sleep(SETTLE_S)


def _drain(stage: Stage, _node: Process | None) -> None:
    count = 100_000
    stage.fill([encode(order) for order in itertools.islice(orders(1), count)])
    stage.wait_for_records(lambda: count)


def _kafka_away(stage: Stage, _node: Process | None) -> None:
    stage.wait_for_records(lambda: 20)
    with _stopped(stage.kafka.pid):
        time.sleep(AWAY_S)


def _kafka_away_all_kept(stage: Stage, node: Process | None) -> None:
    """It is over when Kafka has all pictures but those before the bridge and of a moment."""
    behind = stage.published.stat().st_size - stage.delivered()
    _kafka_away(stage, node)
    stage.wait_for_records(lambda: stage.published.stat().st_size - behind - 30)


def _reader_hung(stage: Stage, node: Process | None) -> None:
    assert node is not None, 'it reads'
    with _stopped(node.pid):
        stage.fill([serialize_message(_picture())] * 600)
        time.sleep(HUNG_S)


@contextmanager
def _stopped(pid: int) -> Iterator[None]:
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


CASES: Final = (
    Case('idle', BACK, None, _idle),
    Case('100,000 orders', BACK, None, _drain),
    Case('camera, KEEP_LAST 10', CAMERA, partial(_camera, 10), _kafka_away),
    Case('camera, KEEP_ALL', CAMERA, partial(_camera, 0), _kafka_away_all_kept),
    Case('lidar, KEEP_LAST 10', LIDAR, _lidar, _kafka_away),
    Case('pictures to ROS', SCREEN, _screen, _reader_hung),
)


def measure(case: Case, console: Console, kafka: LocalKafka) -> Result:
    """Play one situation."""
    mark = uuid.uuid4().hex[:8]
    source, sink = f'memory-{mark}.source', f'memory-{mark}.sink'
    servers = kafka.bootstrap_servers
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='memory-')))
        stack.enter_context(topics(servers, [source, sink], max_message_bytes=str(TOPIC_BYTES)))
        delivered = stack.enter_context(closing(EndOffset(servers, sink)))
        at, published = programs(place, DOMAIN), place / 'leave.out'
        stage = Stage(kafka, place, at, source, sink, delivered, published)
        file = place / 'bridge.yaml'
        begin = f"name: memory\nkafka: {{bootstrap.servers: '{servers}'}}\nroutes:\n"
        file.write_text(begin + case.routes.format(source=source, sink=sink))
        console.print(f'\n{case.what}:\n\n{file.read_text()}', markup=False)

        shm = stack.enter_context(sampled(_shm_mib, LOOK_S))
        node = None if case.node is None else stack.enter_context(case.node(stage))
        if node is not None:
            node.wait_for('ready', START_S)
            beside = stack.enter_context(watched(lambda: node.pid, LOOK_S))
        bridge = stack.enter_context(stage.at.bridge('bridge', file))
        bridge.wait_for('subscribes to' if 'from: {ros' in file.read_text() else 'reads', START_S)
        time.sleep(SETTLE_S)
        seen = stack.enter_context(watched(lambda: bridge.pid, LOOK_S))
        case.play(stage, node)
        time.sleep(SETTLE_S)
        sizes = [it.anon_kib / 1024 for it in seen]
        grown = None if node is None else _growth([it.anon_kib / 1024 for it in beside])
        return Result(case.what, sizes[0], max(sizes), sizes[-1], grown, _growth(shm))


def _shm_mib() -> float:
    return shutil.disk_usage(SHM).used / 2**20


def _growth(sizes: Sequence[float]) -> float:
    return max(sizes) - sizes[0]


def measure_bare(kafka: LocalKafka) -> Result:
    """Let a node be there that moves nothing."""
    mark = uuid.uuid4().hex[:8]
    topic = f'memory-{mark}.to_ros.0'
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='memory-')))
        stack.enter_context(topics(kafka.bootstrap_servers, [topic]))
        ends = kafka.bootstrap_servers, f'memory-{mark}', f'/orders_{mark}', '1'
        words = '-m', 'benchmarks.bare_clients', *ends
        shm = stack.enter_context(sampled(_shm_mib, LOOK_S))
        node = stack.enter_context(programs(place, DOMAIN).python('bare', *words))
        node.wait_for('ready', START_S)
        seen = stack.enter_context(watched(lambda: node.pid, LOOK_S))
        time.sleep(2 * SETTLE_S)
        sizes = [it.anon_kib / 1024 for it in seen]
        return Result('a bare node', sizes[0], max(sizes), sizes[-1], None, _growth(shm))


def main() -> int:
    """Measure all situations and print the table; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--cases', nargs='*', type=int, help='numbers of the situations, from 1')
    chosen = parser.parse_args().cases or range(1, len(CASES) + 1)
    console = Console(highlight=False)
    table = Table('MiB', 'before', 'at most', '5 s after', "node's growth", SHM)
    try:
        with LocalKafka() as kafka:
            measures: list[Callable[[LocalKafka], Result]] = [measure_bare]
            measures += [partial(measure, CASES[number - 1], console) for number in chosen]
            for one in measures:
                result = one(kafka)
                table.add_row(*result.row)
                console.print(*result.row, sep='; ', soft_wrap=True)
    except (ConfigError, TransportError, ProcessError, TimeoutError) as error:
        console.print(str(error), style='red')
        return 1
    console.print(table)
    here = machine()
    parts = [f'{name} {number}' for name, number in versions(is_local_kafka=True).items()]
    console.print(f'{here.cores} cores, {here.cpu}, {here.memory_gib} GiB; {", ".join(parts)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
