"""How late orders are, from the first one on: Kafka -> ROS -> Kafka, beside bare loops.

    python -m benchmarks.latency --rounds 3

Five processes, as in the experiment: producer, Kafka, a bridge for each direction, consumer. The
bridges have stood idle for some seconds before the first order, as those do that serve a shop at
night; each order counts, also the first. The contestants take turns in one run, and their 99th
percentiles are divided by those of bare loops at the same rate in the same round. Apart from that:
how long an order that waits in Kafka takes from the start of both processes on.
"""

import argparse
import itertools
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from rich.console import Console
from rich.table import Table

from benchmarks import command
from benchmarks.experiment.cell import measure, start_up
from benchmarks.experiment.parts import Place
from benchmarks.experiment.results import Cell, Latency, Load
from benchmarks.options import broker, domains, positive, some_of, whole_number
from rig.processes import ProcessError

RATES: Final = (163.0, 2000.0, 10_000.0)
SECONDS: Final = 15.0
ROUNDS: Final = 3
CONTESTANTS: Final = ('bridge', 'bare', 'paper')
DEFAULT: Final = ('bridge', 'bare')
PAPER_DEPTH: Final = 200
DOMAINS: Final = (211, 212, 213, 214)
SEED: Final = 1
# Java compiles what it has run often: no broker in use is as young as one that was just started.
_WARM_UP: Final = Cell('bare', None, Load('warm-up', '1,000 orders/s', 1000.0), 20.0)


class Measured(NamedTuple):
    """One contestant at one rate in one round; latencies in milliseconds."""

    round: int
    rate: float
    contestant: str
    orders: int
    lost: int
    latency: Latency

    @property
    def words(self) -> str:
        """For a line of the terminal."""
        latency = self.latency
        return (
            f'first {latency.first:.1f} ms, median {latency.median:.2f}, 99th {latency.p99:.2f}, '
            f'slowest {latency.slowest:.1f}, {self.lost:,} of {self.orders:,} lost'
        )


class Started(NamedTuple):
    """How long a contestant took to start in one round."""

    round: int
    contestant: str
    seconds: float

    @property
    def words(self) -> str:
        """For a line of the terminal."""
        return f'{self.seconds:.2f} s'


class Found(NamedTuple):
    """All that was measured, and what could not be."""

    measured: Sequence[Measured]
    started: Sequence[Started]
    problems: Sequence[str] = ()


# Measuring


def run(
    options: argparse.Namespace, place: Callable[[], Place], tell: Callable[[str], None]
) -> Found:
    """Let the contestants take turns, round by round; one that fails does not end the others."""
    found: list[Measured | Started] = []
    problems: list[str] = []
    if options.warm_up:
        measure(_WARM_UP, place(), SEED, sys.maxsize)
    for what, task in _tasks(options):
        try:
            found.append(task(place()))
        except ProcessError as error:
            problems.append(f'{what}: not measured: {error}')
            tell(problems[-1])
        else:
            tell(f'{what}: {found[-1].words}')
    return Found(
        [one for one in found if isinstance(one, Measured)],
        [one for one in found if isinstance(one, Started)],
        problems,
    )


def _tasks(
    options: argparse.Namespace,
) -> Iterator[tuple[str, Callable[[Place], Measured | Started]]]:
    """What is to be measured, each with what it is called."""
    for number in range(1, options.rounds + 1):
        # None has always the better place in the row.
        names = options.contestants[:: 1 if number % 2 else -1]
        for name in names:
            yield f'round {number}: start of {name}', partial(_start, number, name)
        for rate, name in itertools.product(options.rates, names):
            what = f'round {number}: {_words(rate)}, {name}'
            yield what, partial(_measure, number, rate, name, options.seconds)


def _start(number: int, name: str, place: Place) -> Started:
    return Started(number, name, start_up(name, _depth(name), place))


def _measure(number: int, rate: float, name: str, seconds: float, place: Place) -> Measured:
    cell = Cell(name, _depth(name), Load(f'{rate:g}', _words(rate), rate), seconds)
    result = measure(cell, place, SEED + number, sys.maxsize)
    if result.latency is None:
        raise ProcessError('nothing came')
    counts = result.counts
    return Measured(number, rate, name, counts.producer, counts.lost, result.latency)


def _depth(name: str) -> int | None:
    return PAPER_DEPTH if name == 'paper' else None


def _words(rate: float) -> str:
    return f'{rate:,g} orders/s'


# Showing


def ratios(measured: Sequence[Measured], rate: float, name: str) -> list[float]:
    """Divide the 99th percentiles of a contestant by those of bare loops, round by round."""
    of = {(one.round, one.contestant): one.latency.p99 for one in measured if one.rate == rate}
    rounds = sorted({number for number, _ in of})
    return [
        of[number, name] / of[number, 'bare']
        for number in rounds
        if (number, name) in of and (number, 'bare') in of
    ]


def show(found: Found, console: Console) -> None:
    """Print the tables."""
    rounds = len({one.round for one in found.measured})
    how = 'one round' if rounds == 1 else f'medians of {rounds} rounds'
    table = Table(title=f'Latency from the first order on, in milliseconds: {how}')
    for title in ('orders/s', ''):
        table.add_column(title)
    for title, _ in _COLUMNS:
        table.add_column(title, justify='right')
    table.add_column('lost', justify='right')
    for (rate, name), of_one in _grouped(found.measured).items():
        values = [statistics.median(map(read, of_one)) for _, read in _COLUMNS]
        lost = sum(one.lost for one in of_one)
        table.add_row(
            f'{rate:,g}', name, *(f'{value:,.1f}' for value in values), f'{lost:,}',
        )  # fmt: skip
    console.print(table)
    for rate, name in _grouped(found.measured):
        if name != 'bare' and (against := ratios(found.measured, rate, name)):
            console.print(f'99th percentile, {_words(rate)}, {name} / bare: {_range(against)}')
    for name in dict.fromkeys(one.contestant for one in found.started):
        seconds = [one.seconds for one in found.started if one.contestant == name]
        console.print(
            f'start-up, {name}: {_range(seconds)} s until an order that waits is through'
        )
    for problem in found.problems:
        console.print(problem)


_COLUMNS: Final[Sequence[tuple[str, Callable[[Measured], float]]]] = (
    ('first', lambda one: one.latency.first),
    ('median', lambda one: one.latency.median),
    ('95th', lambda one: one.latency.p95),
    ('99th', lambda one: one.latency.p99),
    ('99.9th', lambda one: one.latency.p999),
    ('slowest', lambda one: one.latency.slowest),
)


def _grouped(measured: Sequence[Measured]) -> Mapping[tuple[float, str], Sequence[Measured]]:
    groups: dict[tuple[float, str], list[Measured]] = {}
    for one in sorted(measured, key=lambda one: one.rate):
        groups.setdefault((one.rate, one.contestant), []).append(one)
    return groups


def _range(values: Sequence[float]) -> str:
    middle = statistics.median(values)
    return f'{middle:.2f} ({min(values):.2f} to {max(values):.2f})'


def report(found: Found, _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {
        'rounds': [
            {**one._asdict(), 'latency': msgspec.to_builtins(one.latency)}
            for one in found.measured
        ],
        'start_up': [one._asdict() for one in found.started],
        'problems': found.problems,
    }


# The command line


@contextmanager
def _places(options: argparse.Namespace) -> Iterator[Callable[[], Place]]:
    """Start a Kafka unless there is one; yields what makes the next place to measure at."""
    turns = itertools.cycle(options.ros_domains)
    with (
        tempfile.TemporaryDirectory(prefix='latency-') as files,
        broker(options.bootstrap_servers) as kafka,
    ):
        yield lambda: Place(*kafka, next(turns), Path(files), Path(files))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.latency',
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--rates', type=_rates, default=RATES,
        help='orders per second, separated by commas (default: '
        f'{",".join(f"{rate:g}" for rate in RATES)})',
    )  # fmt: skip
    parser.add_argument(
        '--seconds', type=positive, default=SECONDS,
        help='how long orders are sent (default: %(default)g)',
    )  # fmt: skip
    parser.add_argument('--rounds', type=whole_number, default=ROUNDS, help='default: %(default)s')
    parser.add_argument(
        '--contestants', type=some_of(CONTESTANTS), default=DEFAULT,
        help=f'of {", ".join(CONTESTANTS)}: in turn (default: {",".join(DEFAULT)})',
    )  # fmt: skip
    parser.add_argument(
        '--no-warm-up', dest='warm_up', action='store_false',
        help='measure on a broker that has served nobody yet',
    )  # fmt: skip
    parser.add_argument(
        '--ros-domains', type=domains, default=DOMAINS, help='in turn (default: %(default)s)'
    )
    parser.add_argument('--bootstrap-servers', help='default: a Kafka is started for the run')
    return command.run(
        parser, arguments, _measure_all, show, report, lambda found: not found.problems,
        says_versions=True,
    )  # fmt: skip


def _measure_all(options: argparse.Namespace, console: Console) -> Found:
    with _places(options) as place:
        return run(options, place, console.print)


def _rates(text: str) -> list[float]:
    return [positive(word) for word in dict.fromkeys(text.split(','))]


if __name__ == '__main__':
    sys.exit(main())
