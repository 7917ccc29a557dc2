"""How much memory a bridge with two routes takes, in five situations, and a bare node before it.

    python -m benchmarks.memory

One process runs both routes, Kafka -> ROS -> Kafka, on a real Kafka, with default settings
(`max_samples: 50` where messages have 1 MB). Each situation has a process of its own. Measured
is anonymous memory: what no other process shares and no file backs. (PYTHONDONTWRITEBYTECODE must
not be set: where Python compiles what it imports, that takes memory, too.) The bare node has a
publisher, a subscription, a consumer and a producer, and moves nothing.
"""

import argparse
import itertools
import os
import signal
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.machine import machine, versions
from benchmarks.processes import programs
from benchmarks.topics import EndOffset, fill, topics
from benchmarks.vitals import watched
from rig.processes import ProcessError, Programs
from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_bridge.testing.orders import encode, orders

START_S: Final = 60.0
SETTLE_S: Final = 10.0
STALL_S: Final = 20.0
LONGEST_S: Final = 180.0
LOOK_S: Final = 0.05
FOR_EVER_S: Final = 3600.0
LARGE_BYTES: Final = 950_000
DOMAIN: Final = 214

FILE: Final = """\
name: memory
kafka: {{bootstrap.servers: '{servers}'}}
defaults: {{drain_s: 1}}
routes:
  - name: to_ros
    from: {{kafka: {source}, start: earliest}}
    to: {{ros: /orders_{mark}, type: std_msgs/msg/String}}
    format: text
  - name: to_kafka
    from: {{ros: /{back}_{mark}, type: std_msgs/msg/String{samples}}}
    to: {{kafka: {sink}}}
    format: text
"""


class Case(NamedTuple):
    """A situation.

    Args:
        what: In the table.
        values: What the source topic holds at the start.
        back: Which ROS topic goes back to Kafka: `orders`, what the first route publishes, or
            another one.
        large: Whether messages are large, so that DDS shall keep fewer.
        play: Makes it happen; returns when it has.
    """

    what: str
    values: Callable[[], Sequence[bytes]]
    back: str
    large: bool
    play: 'Callable[[Stage], None]'


class Stage(NamedTuple):
    """What a situation works with."""

    kafka: LocalKafka
    mark: str
    at: Programs
    sent: int
    delivered: EndOffset

    @contextmanager
    def peer(self, end: str, topic: str, *options: str) -> Iterator[None]:
        """Run a ROS node beside."""
        with self.at.peer(end, end, f'/{topic}_{self.mark}', *options) as node:
            node.wait_for('ready', START_S)
            yield


class Result(NamedTuple):
    """Anonymous memory in MiB: at the end of the situation, and the most that was seen."""

    what: str
    last_mib: float
    peak_mib: float


def _idle(_: Stage) -> None:
    time.sleep(SETTLE_S)


def _drain(stage: Stage) -> None:
    deadline_s = time.monotonic() + LONGEST_S
    while stage.delivered() < stage.sent:
        if time.monotonic() > deadline_s:
            raise TimeoutError(f'{stage.delivered()} of {stage.sent} messages came through')
        time.sleep(0.2)


def _stalled_reader(stage: Stage) -> None:
    with stage.peer('subscriber', 'orders', os.devnull, '--work', str(FOR_EVER_S)):
        time.sleep(STALL_S)


def _stalled_kafka(stage: Stage) -> None:
    with stage.peer('publisher', 'other', '--size', str(LARGE_BYTES), '--rate', '50'):
        time.sleep(2)
        os.kill(stage.kafka.pid, signal.SIGSTOP)
        try:
            time.sleep(STALL_S)
        finally:
            os.kill(stage.kafka.pid, signal.SIGCONT)


def _small() -> Sequence[bytes]:
    return [encode(order) for order in itertools.islice(orders(1), 100_000)]


def _large() -> Sequence[bytes]:
    return [b'x' * LARGE_BYTES] * 300


CASES: Final = (
    Case('idle', lambda: (), 'orders', large=False, play=_idle),
    Case('100,000 orders as fast as they go', _small, 'orders', large=False, play=_drain),
    Case('300 messages of 1 MB', _large, 'orders', large=True, play=_drain),
    Case('1 MB, the ROS reader stands still', _large, 'other', large=True, play=_stalled_reader),
    Case('1 MB, Kafka stands still', lambda: (), 'other', large=True, play=_stalled_kafka),
)


def measure(case: Case, kafka: LocalKafka) -> Result:
    """Play one situation."""
    mark = uuid.uuid4().hex[:8]
    source, sink = f'memory-{mark}.source', f'memory-{mark}.sink'
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='memory-')))
        stack.enter_context(topics(kafka.bootstrap_servers, [source, sink]))
        values = case.values()
        fill(kafka.bootstrap_servers, source, values)
        file = place / 'bridge.yaml'
        samples = ', max_samples: 50' if case.large else ''
        servers = kafka.bootstrap_servers
        file.write_text(
            FILE.format(
                servers=servers,
                source=source,
                sink=sink,
                mark=mark,
                back=case.back,
                samples=samples,
            )
        )
        at = programs(place, DOMAIN)
        bridge = stack.enter_context(at.bridge('bridge', file))
        bridge.wait_for('reads', START_S)
        delivered = stack.enter_context(closing(EndOffset(servers, sink)))
        stage = Stage(kafka, mark, at, len(values), delivered)
        seen = stack.enter_context(watched(lambda: bridge.pid, LOOK_S))
        case.play(stage)
        most_kib = max(vitals.anon_kib for vitals in seen)
        return Result(case.what, seen[-1].anon_kib / 1024, most_kib / 1024)


def measure_bare(kafka: LocalKafka) -> Result:
    """Let a node be there that moves nothing."""
    mark = uuid.uuid4().hex[:8]
    topic = f'memory-{mark}.to_ros.0'
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='memory-')))
        stack.enter_context(topics(kafka.bootstrap_servers, [topic]))
        ends = kafka.bootstrap_servers, f'memory-{mark}', f'/orders_{mark}', '1'
        words = '-m', 'benchmarks.bare_clients', *ends
        node = stack.enter_context(programs(place, DOMAIN).python('bare', *words))
        node.wait_for('ready', START_S)
        seen = stack.enter_context(watched(lambda: node.pid, LOOK_S))
        time.sleep(SETTLE_S)
        most_kib = max(vitals.anon_kib for vitals in seen)
        return Result('a bare node, idle', seen[-1].anon_kib / 1024, most_kib / 1024)


def main() -> int:
    """Measure all situations and print the table; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--cases', nargs='*', type=int, help='numbers of the situations, from 1')
    chosen = parser.parse_args().cases or range(1, len(CASES) + 1)
    console = Console(highlight=False)
    table = Table('situation', 'MiB at the end', 'MiB at most')
    try:
        with LocalKafka() as kafka:
            measures: list[Callable[[LocalKafka], Result]] = [measure_bare]
            measures += [partial(measure, CASES[number - 1]) for number in chosen]
            for one in measures:
                result = one(kafka)
                table.add_row(result.what, f'{result.last_mib:.1f}', f'{result.peak_mib:.1f}')
                console.print(f'{result.what}: {result.peak_mib:.1f} MiB at most')
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
