"""The paper's experiment (section VII), repeated and widened.

    make experiment
    python -m benchmarks.experiment --loads 9.6,86,160 --seconds 600

Five processes pass orders on: kafka-producer, Kafka (real, one partition, one replica), the
kafka-ros bridge, the ros-kafka bridge, kafka-consumer. A cell of the grid is a load, a contestant
and, for those with KEEP_LAST, a depth. What is measured is kept cell by cell: Ctrl-C ends a run,
the same command goes on with it.
"""

import argparse
import math
import shlex
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

import msgspec
from confluent_kafka import KafkaException
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from benchmarks.experiment import results
from benchmarks.experiment.cell import measure, start_up
from benchmarks.experiment.grid import (
    CONTESTANTS,
    DEPTHS,
    LOADS,
    MOST_ORDERS,
    SECONDS,
    cells,
    expected_s,
)
from benchmarks.experiment.parts import Place
from benchmarks.experiment.predictions import predictions
from benchmarks.experiment.report import write_report
from benchmarks.experiment.results import Cell, Experiment, Load, Result, Setting, StartUp
from benchmarks.machine import machine, versions
from benchmarks.options import broker, domains, positive, some_of, whole_number, whole_numbers
from rig.processes import ProcessError
from ros2_kafka_bridge.errors import ConfigError, TransportError

OUT: Final = Path('build/experiment')
DOMAINS: Final = (211, 212, 213, 214)
SEED: Final = 1
# Java compiles what it has run often: a broker that has not served some ten thousand requests yet
# takes three times as long for each. The first cells would measure that, and no broker in use is
# so young; hence also the highest loads come first.
_WARM_UP: Final = Load('warm-up', '1,000 orders/s', 1000.0)
_WARM_UP_S: Final = 20.0
_STARTS: Final = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is not measured yet, and write the report; returns the exit status."""
    options = _parse(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console(highlight=False)
    grid = cells(options.loads, options.contestants, options.depths, options.seconds)
    try:
        setting = _setting(options, arguments)
        status = _measure_all(grid, options, console)
        report = _report(grid, options.out, setting)
    except KeyboardInterrupt:
        return 130
    except (ConfigError, TransportError, KafkaException, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    console.print(f'the report: {report}')
    return status


# Measuring


def _measure_all(grid: Sequence[Cell], options: argparse.Namespace, console: Console) -> int:
    """Measure all cells that are not kept; returns the exit status."""
    todo = [cell for cell in grid if options.again or results.kept(options.out, cell) is None]
    todo.sort(key=lambda cell: cell.load.of_paper)
    if len(todo) < len(grid):
        console.print(
            f'{len(grid) - len(todo)} of {len(grid)} cells are kept from before '
            '(--again measures them anew)'
        )
    runs = dict.fromkeys((cell.contestant, cell.depth) for cell in grid)
    runs.pop(('recording', None), None)
    starts = [run for run in runs if options.again or not results.kept_start(options.out, *run)]
    if not todo and not starts:
        return 0
    status = 0
    try:
        with _kafka(options) as place:
            _measure(Cell('bare', None, _WARM_UP, _WARM_UP_S), place(0), options)
            for run in starts:
                status |= _measure_start(*run, place, options.out, console)
            with _progress(todo, options.most_orders, console) as next_cell:
                for number, cell in enumerate(todo):
                    result = _measure(cell, place(number), options)
                    if isinstance(result, Result):
                        results.keep(options.out, result)
                    else:
                        status = 1
                    next_cell(cell, result)
    except KeyboardInterrupt:
        console.print('stopped: what was measured is kept, the same command goes on')
        status = 130
    return status


def _measure_start(
    contestant: str,
    depth: int | None,
    place: Callable[[int], Place],
    out: Path,
    console: Console,
) -> int:
    """Measure how long a contestant takes to start; returns the exit status."""
    words = f'start-up of {contestant}{"" if depth is None else f"-{depth}"}'
    try:
        seconds = [start_up(contestant, depth, place(number)) for number in range(_STARTS)]
    except ProcessError as error:
        console.print(f'{words}: NOT MEASURED: {error}', soft_wrap=True)
        return 1
    results.keep_start(out, StartUp(contestant, depth, seconds))
    console.print(f'{words}: {statistics.median(seconds):.2f} s', soft_wrap=True)
    return 0


def _measure(cell: Cell, place: Place, options: argparse.Namespace) -> Result | ProcessError:
    try:
        return measure(cell, place, options.seed, options.most_orders)
    except ProcessError as error:
        return error


@contextmanager
def _kafka(options: argparse.Namespace) -> Iterator[Callable[[int], Place]]:
    """Start a Kafka unless there is one; yields what makes the place of a cell."""
    logs, recordings = options.out / 'logs', options.out / 'recordings'
    chosen = options.ros_domains
    with broker(options.bootstrap_servers) as kafka:
        yield lambda number: Place(*kafka, chosen[number % len(chosen)], logs, recordings)


@contextmanager
def _progress(
    todo: Sequence[Cell], most: int, console: Console
) -> Iterator[Callable[[Cell, Result | ProcessError], None]]:
    """Show how far the run is; yields what is called after each cell."""
    left_s = [sum(expected_s(cell, most) for cell in todo)]
    columns = (
        TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
        TextColumn('about {task.fields[left]} min left'),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task('cells', total=len(todo), left=_minutes(left_s[0]))

        def after(cell: Cell, result: Result | ProcessError) -> None:
            left_s[0] -= expected_s(cell, most)
            console.print(f'{cell.key:20} {_line(result)}', soft_wrap=True)
            progress.update(task, advance=1, left=_minutes(left_s[0]))

        yield after


def _minutes(seconds: float) -> str:
    return str(math.ceil(seconds / 60))


def _line(result: Result | ProcessError) -> str:
    if isinstance(result, ProcessError):
        return f'NOT MEASURED: {result}'
    counts = result.counts
    took = f', median {result.latency.median:,.1f} ms' if result.latency else ''
    took += f', 99th {result.latency.p99:,.1f} ms' if result.latency else ''
    return (
        f'{counts.producer:,} orders, lost {counts.lost:,} ({100 * counts.loss:.2f} %), '
        f'{counts.duplicated} twice, {counts.out_of_order} out of order{took}'
    )


# The report


def _report(grid: Sequence[Cell], out: Path, setting: Setting) -> Path:
    found = [result for cell in grid if (result := results.kept(out, cell)) is not None]
    runs = dict.fromkeys((cell.contestant, cell.depth) for cell in grid)
    starts = [one for run in runs if (one := results.kept_start(out, *run)) is not None]
    experiment = Experiment(setting, found, predictions(found, out / 'recordings'), starts)
    results.write(out, experiment)
    return write_report(experiment, out)


def _setting(options: argparse.Namespace, arguments: Sequence[str] | None) -> Setting:
    """Say what this run is made with.

    Raises:
        ConfigError: The results that are kept were made with something else.
    """
    given = sys.argv[1:] if arguments is None else arguments
    setting = Setting(
        command=shlex.join(['python', '-m', 'benchmarks.experiment', *given]),
        started=datetime.now(UTC).isoformat(timespec='seconds'),
        seconds=options.seconds,
        machine=machine()._asdict(),
        versions={
            **versions(is_local_kafka=options.bootstrap_servers is None),
            'ros2-kafka-bridge': _commit(),
        },
        kafka=options.bootstrap_servers or 'local',
        seed=options.seed,
        most_orders=options.most_orders,
    )
    before = results.setting(options.out)
    fixed = ('machine', 'versions', 'kafka', 'seed', 'most_orders')
    other = [name for name in fixed if getattr(before, name, None) != getattr(setting, name)]
    if before is not None and not other:
        return msgspec.structs.replace(setting, started=before.started)
    if before is None or options.again:
        results.forget(options.out)
        results.keep_setting(options.out, setting)
        return setting
    if other:
        what = ', '.join(other)
        raise ConfigError(
            [f'{options.out}: made with another {what}: give another --out, or --again']
        )
    return setting


def _commit() -> str:
    """The state of this repository; the version of the package where there is no repository."""
    command = ['git', '-C', str(Path(__file__).parent), 'describe', '--always', '--dirty']
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return version('ros2-kafka-bridge')


# The command line


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.experiment',
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    loads = ','.join(load.name for load in LOADS)
    parser.add_argument(
        '--seconds', type=positive, default=SECONDS,
        help='how long orders are sent in a cell (default: %(default)g; the paper: 600)',
    )  # fmt: skip
    parser.add_argument(
        '--loads', type=_loads, default=LOADS, help=f'in orders per second (default: {loads})'
    )
    parser.add_argument(
        '--contestants', type=some_of(CONTESTANTS), default=CONTESTANTS,
        help=f'separated by commas (default: {",".join(CONTESTANTS)})',
    )  # fmt: skip
    parser.add_argument(
        '--depths', type=whole_numbers, default=DEPTHS,
        help=f'of KEEP_LAST (default: {",".join(map(str, DEPTHS))})',
    )  # fmt: skip
    parser.add_argument(
        '--most-orders', type=whole_number, default=MOST_ORDERS,
        help='of one cell, however fast they are sent (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=SEED, help='of the orders')
    parser.add_argument('--bootstrap-servers', help='default: a Kafka is started for the run')
    parser.add_argument(
        '--ros-domains', type=domains, default=DOMAINS, help='in turn (default: %(default)s)'
    )
    parser.add_argument('--out', type=Path, default=OUT, help='default: %(default)s')
    parser.add_argument(
        '--again', action='store_true', help='measure cells anew that are measured already'
    )
    return parser.parse_args(arguments)


def _loads(text: str) -> list[Load]:
    known = {load.name: load for load in LOADS}
    return [known[name] for name in some_of(known)(text)]


if __name__ == '__main__':
    sys.exit(main())
