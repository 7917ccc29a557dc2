"""Many routes in one bridge: how long until all run, what each of them takes, does all arrive?

    python -m benchmarks.routes --routes 200

Half of them go each way, each between topics of its own. A second bridge with two routes tells
what is there for all of them. In the end one message goes through each route.
"""

import argparse
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Final, NamedTuple

from confluent_kafka import Consumer, Producer
from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.processes import programs
from benchmarks.topics import topics
from benchmarks.vitals import Vitals, vitals
from rig.processes import direct
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

DOMAIN: Final = 222
START_S: Final = 300.0
ARRIVE_S: Final = 180.0
END_S: Final = 60.0
SETTLE_S: Final = 5.0
LOOK_S: Final = 0.05

HEAD: Final = """\
name: routes
kafka: {{bootstrap.servers: '{servers}'}}
defaults: {{format: text}}
routes:
"""
TO_ROS: Final = """\
  - name: to_ros_{number}
    from: {{kafka: {mark}.to_ros.{number}, start: earliest}}
    to: {{ros: /to_ros_{mark}/n{number}, type: std_msgs/msg/String}}
"""
TO_KAFKA: Final = """\
  - name: to_kafka_{number}
    from: {{ros: /to_kafka_{mark}/n{number}, type: std_msgs/msg/String}}
    to: {{kafka: {mark}.to_kafka.{number}}}
"""


class Result(NamedTuple):
    """What a bridge with so many routes did.

    Args:
        checked_s: How long `check` took for the file.
        ready_s: From the start of the process until every route read or subscribed.
        vitals: A moment later.
        to_ros_s: From the first record produced until each route had delivered its one.
        to_kafka_s: The same the other way.
        arrived: Routes to ROS and routes to Kafka whose message came, once.
        repeated: Messages that came again.
        ended_s: How long the stop took.
    """

    routes: int
    checked_s: float
    ready_s: float
    vitals: Vitals
    to_ros_s: float
    to_kafka_s: float
    arrived: tuple[int, int]
    repeated: int
    ended_s: float
    status: int

    @property
    def sound(self) -> bool:
        """Whether each route delivered, and the bridge ended well."""
        return sum(self.arrived) == self.routes and not self.repeated and self.status == 0


def measure(servers: str, routes: int) -> Result:
    """Run a bridge with so many routes, half each way."""
    mark = f'routes_{uuid.uuid4().hex[:8]}'
    half = routes // 2
    names = {way: [f'{mark}.{way}.{number}' for number in range(half)] for way in WAYS}
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='routes-')))
        at = programs(place, DOMAIN, direct)
        stack.enter_context(topics(servers, [name for way in WAYS for name in names[way]]))
        file = place / 'routes.yaml'
        file.write_text(bridge_file(servers, mark, half))
        begun_s = time.monotonic()
        with at.python('check', *BRIDGE, 'check', str(file)) as check:
            check.wait(END_S)
        checked_s = time.monotonic() - begun_s
        begun_s = time.monotonic()
        bridge = stack.enter_context(at.bridge('bridge', file))
        bridge.wait_for(' reads ', START_S, half)
        bridge.wait_for(' subscribes to ', START_S, half)
        ready_s = time.monotonic() - begun_s
        time.sleep(SETTLE_S)
        held = vitals(bridge.pid)
        came = [place / f'came-{number}' for number in range(half)]
        takes, sends = place / 'takes', place / 'sends'
        takes.write_text(
            ''.join(f'/to_ros_{mark}/n{n} {STRING} {file}\n' for n, file in enumerate(came))
        )
        sends.write_text(
            ''.join(f'/to_kafka_{mark}/n{n} {STRING} {EMPTY.hex()}\n' for n in range(half))
        )
        node = 'ros_node', '--durability', 'volatile'
        reader = at.peer('read', *node, '--take', str(takes), '--writers', '1')
        stack.enter_context(reader).wait_for('ready', START_S)
        begun_s = time.monotonic()
        _produce(servers, names['to_ros'])
        _wait_for(came)
        to_ros_s = time.monotonic() - begun_s
        begun_s = time.monotonic()
        writer = at.peer('write', *node, '--publish', str(sends), '--readers', '1')
        stack.enter_context(writer)
        found = _consume(servers, names['to_kafka'])
        to_kafka_s = time.monotonic() - begun_s
        begun_s = time.monotonic()
        status = bridge.end(END_S)
        ended_s = time.monotonic() - begun_s
        reader.end(END_S)
        got = sum(len(file.read_text().splitlines()) for file in came)
    repeated = got - half + found.total() - len(found)
    arrived = half, len(found)
    return Result(
        2 * half, checked_s, ready_s, held, to_ros_s, to_kafka_s, arrived, repeated, ended_s,
        status,
    )  # fmt: skip


WAYS: Final = ('to_ros', 'to_kafka')
BRIDGE: Final = ('-m', 'ros2_kafka_bridge')
STRING: Final = 'std_msgs/msg/String'
EMPTY: Final = b'\0\1\0\0\1\0\0\0\0'


def bridge_file(servers: str, mark: str, half: int) -> str:
    """The configuration of a bridge with so many routes each way."""
    parts = [HEAD.format(servers=servers)]
    for number in range(half):
        parts += [form.format(mark=mark, number=number) for form in (TO_ROS, TO_KAFKA)]
    return ''.join(parts)


def _produce(servers: str, names: Sequence[str]) -> None:
    producer = Producer({'bootstrap.servers': servers, 'log_level': 3})
    for name in names:
        producer.produce(name, name)
    if left := producer.flush(ARRIVE_S):
        raise TimeoutError(f'Kafka did not take {left} records')


def _wait_for(files: Sequence[Path]) -> None:
    deadline_s = time.monotonic() + ARRIVE_S
    while left := sum(not file.exists() for file in files):
        if time.monotonic() > deadline_s:
            raise TimeoutError(f'{left} of {len(files)} routes to ROS have delivered nothing')
        time.sleep(LOOK_S)


def _consume(servers: str, names: Sequence[str]) -> Counter[str]:
    """How many records each topic got; waits until each has one, and a little longer."""
    config = {
        'bootstrap.servers': servers,
        'group.id': names[0],
        'auto.offset.reset': 'earliest',
        'enable.auto.commit': False,
    }
    found: Counter[str] = Counter()
    with closing(Consumer(config)) as consumer:
        consumer.subscribe(list(names))
        deadline_s = time.monotonic() + ARRIVE_S
        while len(found) < len(names) and time.monotonic() < deadline_s:
            found.update(_came(consumer, LOOK_S))
        found.update(_came(consumer, 1.0))
    return found


def _came(consumer: Consumer, timeout_s: float) -> Iterator[str]:
    for record in consumer.consume(1000, timeout_s):
        if record.error() is None:
            yield str(record.topic())


# The report


def show(results: tuple[Result, Result], console: Console) -> None:
    """Print the table."""
    few, many = results
    table = Table('', f'{few.routes} routes', f'{many.routes} routes', 'each more')
    for words, read in _ROWS:
        a, b = read(few), read(many)
        each = (b - a) / max(1, many.routes - few.routes)
        table.add_row(words, f'{a:,.1f}', f'{b:,.1f}', f'{each:,.3f}')
    console.print(table)
    for one in results:
        console.print(
            f'{one.routes} routes: {one.arrived[0]} of {one.routes // 2} to ROS and '
            f'{one.arrived[1]} of {one.routes // 2} to Kafka delivered, {one.repeated} repeated, '
            f'status {one.status}'
        )


_ROWS: Final[Sequence[tuple[str, Callable[[Result], float]]]] = (
    ('check of the file, s', lambda r: r.checked_s),
    ('start until all run, s', lambda r: r.ready_s),
    ('memory, MiB', lambda r: r.vitals.anon_kib / 1024),
    ('threads', lambda r: r.vitals.threads),
    ('descriptors', lambda r: r.vitals.descriptors),
    ('first message through each, to ROS, s', lambda r: r.to_ros_s),
    ('the same to Kafka, with the start of the publisher, s', lambda r: r.to_kafka_s),
    ('stop, s', lambda r: r.ended_s),
)


def report(results: tuple[Result, Result], _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {
        'results': [{**one._asdict(), 'vitals': one.vitals._asdict()} for one in results],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status: 1 where a route did not deliver."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.routes', description='Runs many routes in one bridge.'
    )
    parser.add_argument('--routes', type=int, default=200, help='default: %(default)s')
    return run(parser, arguments, _measure, show, report, lambda two: all(it.sound for it in two))


def _measure(options: argparse.Namespace, _: Console) -> tuple[Result, Result]:
    with LocalKafka() as kafka:
        few = measure(kafka.bootstrap_servers, 2)
        return few, measure(kafka.bootstrap_servers, options.routes)


if __name__ == '__main__':
    sys.exit(main())
