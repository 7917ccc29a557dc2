"""What a bridge takes that has nothing to do, beside the same number of bare clients.

    python -m benchmarks.idle --routes 2 50 [--workers 2]

Half of the routes go each way. A node with as many endpoints, consumers and producers stands
beside the bridge, and both are looked at over the same seconds.
"""

import argparse
import sys
import tempfile
import time
import uuid
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.processes import of_family, programs
from benchmarks.routes import bridge_file
from benchmarks.topics import topics
from rig.processes import direct
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

DOMAIN: Final = 223
START_S: Final = 300.0
SETTLE_S: Final = 8.0


class Result(NamedTuple):
    """What both took, in cores: CPU seconds for each second.

    Args:
        routes: Of the bridge, half of them each way.
        bare: As many clients of Kafka and endpoints of ROS, and no bridge.
    """

    routes: int
    bridge: float
    bare: float

    @property
    def ratio(self) -> float:
        """How many times the bare clients the bridge takes."""
        return self.bridge / self.bare


def measure(servers: str, routes: int, workers: int, seconds: float) -> Result:
    """Let both stand idle beside each other; the supervisor of several workers counts, too."""
    mark = f'idle_{uuid.uuid4().hex[:8]}'
    half = routes // 2
    names = [f'{mark}.{way}.{number}' for way in ('to_ros', 'to_kafka') for number in range(half)]
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='idle-')))
        at = programs(place, DOMAIN, direct)
        stack.enter_context(topics(servers, names))
        file = place / 'idle.yaml'
        file.write_text(f'workers: {workers}\n{bridge_file(servers, mark, half)}')
        bridge = stack.enter_context(at.bridge('bridge', file))
        bridge.wait_for(' reads ', START_S, half)
        bridge.wait_for(' subscribes to ', START_S, half)
        words = '-m', 'benchmarks.bare_clients', servers, mark, f'/bare_{mark}', str(half)
        bare = stack.enter_context(at.python('bare', *words))
        bare.wait_for('ready', START_S)
        time.sleep(SETTLE_S)
        begun_s = time.monotonic()
        before = [of_family(process.pid).cpu_s for process in (bridge, bare)]
        time.sleep(seconds)
        after = [of_family(process.pid).cpu_s for process in (bridge, bare)]
        took_s = time.monotonic() - begun_s
        each = [(b - a) / took_s for a, b in zip(before, after, strict=True)]
        return Result(2 * half, *each)


def show(results: Sequence[Result], console: Console) -> None:
    """Print the table."""
    table = Table('routes', 'the bridge, % of a core', 'bare clients', 'ratio')
    for one in results:
        table.add_row(
            f'{one.routes:,}', f'{100 * one.bridge:.2f}', f'{100 * one.bare:.2f}',
            f'{one.ratio:.2f}',
        )  # fmt: skip
    console.print(table)


def report(results: Sequence[Result], _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {'results': [one._asdict() for one in results]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.idle', description='Lets bridges stand idle.'
    )
    parser.add_argument('--routes', type=int, nargs='+', default=[2, 50])
    parser.add_argument('--workers', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--seconds', type=float, default=20.0, help='default: %(default)s')
    return run(parser, arguments, _measure, show, report)


def _measure(options: argparse.Namespace, _: Console) -> Sequence[Result]:
    with LocalKafka() as kafka:
        return [
            measure(kafka.bootstrap_servers, routes, options.workers, options.seconds)
            for routes in options.routes
        ]


if __name__ == '__main__':
    sys.exit(main())
