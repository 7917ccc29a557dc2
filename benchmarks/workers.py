"""Both directions in one process against a worker for each.

    python -m benchmarks.workers --rounds 3

The drain of `benchmarks.drain`, through one configuration with two routes, as it is run by
`workers: 1` and by `workers: 2`, in turn. CPU time and memory are those of all processes of the
bridge, the supervisor included.
"""

import argparse
import contextlib
import itertools
import os
import statistics
import sys
import tempfile
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.contestants import BRIDGE_FILE
from benchmarks.drain import Pages, Watched, watch
from benchmarks.machine import machine
from benchmarks.processes import programs
from benchmarks.topics import EndOffset, count, fill, topics
from rig.processes import direct
from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_bridge.testing.orders import encode, orders

DOMAIN: Final = 218


class Result(NamedTuple):
    """What one way did in one round.

    Args:
        cpu_us: Microseconds of CPU time per delivered order, from the first record on.
        anon_mib: Most anonymous memory seen.
    """

    workers: int
    orders_per_s: float
    lost: int
    duplicated: int
    cpu_us: float
    anon_mib: float


def drain(bootstrap_servers: str, workers: int, values: Sequence[bytes]) -> Result:
    """Drain one full topic through both directions."""
    mark = uuid.uuid4().hex[:8]
    source, sink = f'workers-{mark}.source', f'workers-{mark}.sink'
    with (
        tempfile.TemporaryDirectory(prefix='workers-') as place,
        topics(bootstrap_servers, [source, sink]),
        contextlib.closing(EndOffset(bootstrap_servers, sink)) as end_offset,
    ):
        fill(bootstrap_servers, source, values)
        file = Path(place, 'bridge.yaml')
        text = BRIDGE_FILE.format(
            bootstrap_servers=bootstrap_servers,
            source=source,
            sink=sink,
            qos='',
            ros_topic=f'/w_{mark}',
        )
        file.write_text(f'workers: {workers}\n{text}', encoding='utf-8')
        at = programs(Path(place), DOMAIN, direct)
        with at.bridge(f'workers: {workers}', file) as process:
            side = Watched(process, [])
            _, first, last = watch(end_offset, [side], Pages(()))
        tally = count(bootstrap_servers, sink, end_offset())
    return Result(
        workers,
        1000 * tally.delivered / max(tally.last_ms - tally.first_ms, 1),
        len(values) - tally.delivered,
        tally.duplicated,
        *side.side(first, last, tally.delivered),
    )


def show(results: Sequence[Result], count: int, console: Console) -> None:
    """Print the medians, and how far the rounds lie apart."""
    table = Table(title=f'{count:,} orders, medians (least to most)')
    table.add_column('')
    by_workers = {n: [r for r in results if r.workers == n] for n in (1, 2)}
    for workers in by_workers:
        table.add_column(f'workers: {workers}', justify='right')
    for words, read in _ROWS:
        table.add_row(words, *(_range([read(r) for r in of]) for of in by_workers.values()))
    console.print(table)
    here = machine()
    console.print(f'{here.cores} cores of {here.cpu}, load {os.getloadavg()[0]:.1f} at the end')


def _range(values: Sequence[float]) -> str:
    return f'{statistics.median(values):,.1f} ({min(values):,.1f} to {max(values):,.1f})'


_ROWS: Final[Sequence[tuple[str, Callable[[Result], float]]]] = (
    ('orders/s delivered', lambda r: r.orders_per_s),
    ('lost', lambda r: r.lost),
    ('duplicated', lambda r: r.duplicated),
    ('CPU µs/order, all processes', lambda r: r.cpu_us),
    ('RssAnon MiB, all processes', lambda r: r.anon_mib),
)


def main() -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.workers')
    parser.add_argument('--orders', type=int, default=150_000, help='default: %(default)s')
    parser.add_argument('--rounds', type=int, default=3, help='default: %(default)s')
    options = parser.parse_args()
    console = Console(highlight=False)
    values = [encode(order) for order in itertools.islice(orders(1), options.orders)]
    results = []
    with LocalKafka() as kafka:
        for number, workers in itertools.product(range(1, options.rounds + 1), (1, 2)):
            result = drain(kafka.bootstrap_servers, workers, values)
            results.append(result)
            console.print(
                f'round {number}: workers {workers}: {result.orders_per_s:,.0f} orders/s'
            )
    show(results, options.orders, console)
    return 0


if __name__ == '__main__':
    sys.exit(main())
