"""How fast a topic of orders drains through both directions: Kafka -> ROS -> Kafka.

    python -m benchmarks.drain --rounds 3

Three contestants take turns in one run, each on topics and in a ROS domain of its own, each with
one process for each direction: `paper`, `bridge` and `bare` (see `contestants`). The source topic
is full before they start. Measured is the time between the first and the last record in the sink
topic, by the broker's clock; what arrived is counted afterwards, so that no reader takes part in
the race. CPU time is per delivered order, from the first record on.
"""

import argparse
import contextlib
import itertools
import json
import signal
import statistics
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from confluent_kafka import KafkaException
from rich.console import Console
from rich.table import Table

from benchmarks.contestants import CONTESTANTS, Contestant, Ends
from benchmarks.machine import machine, versions
from benchmarks.processes import Process, ProcessError, Usage
from benchmarks.topics import EndOffset, count, fill, topics
from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_bridge.testing.orders import encode, orders

ORDERS: Final = 150_000
SEED: Final = 1
DOMAINS: Final = (215, 216, 217)
START_S: Final = 60.0
FIRST_LOOK_S: Final = 0.02
LOOK_S: Final = 0.2
STABLE_S: Final = 3.0


class Side(NamedTuple):
    """What one process has used.

    Args:
        cpu_us: Microseconds of CPU time per delivered order.
        anon_mib: Most anonymous memory seen.
    """

    cpu_us: float
    anon_mib: float


class Result(NamedTuple):
    """What one contestant did in one round."""

    contestant: str
    round: int
    orders: int
    delivered: int
    duplicated: int
    out_of_order: int
    seconds: float
    kafka_to_ros: Side
    ros_to_kafka: Side

    @property
    def lost(self) -> int:
        """Orders that never arrived."""
        return self.orders - self.delivered

    @property
    def rate(self) -> float:
        """Orders delivered per second."""
        return self.delivered / self.seconds


class Watched(NamedTuple):
    """A process, and what was seen of it."""

    process: Process
    seen: list[Usage]

    def look(self) -> None:
        """Note what it has used."""
        self.seen.append(self.process.usage())

    def side(self, first: int, last: int, delivered: int) -> Side:
        """Sum up, between two looks."""
        cpu_s = self.seen[last].cpu_s - self.seen[first].cpu_s
        return Side(1e6 * cpu_s / delivered, max(usage.anon_mib for usage in self.seen))


# The run


def run_rounds(
    options: argparse.Namespace, bootstrap_servers: str, tell: Callable[[str], None]
) -> list[Result]:
    """Let the contestants take turns; returns what each did in each round."""
    values = [encode(order) for order in itertools.islice(orders(SEED), options.orders)]
    domains = itertools.cycle(options.ros_domains)
    results = []
    for number, name in itertools.product(range(1, options.rounds + 1), options.contestants):
        with tempfile.TemporaryDirectory(prefix='drain-') as place:
            ends = _ends(bootstrap_servers, name, Path(place))
            result = drain(name, number, ends, values, next(domains))
        tell(f'round {number}: {_line(result)}')
        results.append(result)
    return results


def _ends(bootstrap_servers: str, name: str, place: Path) -> Ends:
    mark = uuid.uuid4().hex[:8]
    stem = f'drain-{name}-{mark}'
    return Ends(bootstrap_servers, f'{stem}.source', f'/drain_{mark}', f'{stem}.sink', place)


def drain(name: str, number: int, ends: Ends, values: Sequence[bytes], domain: int) -> Result:
    """Drain one full topic through one contestant."""
    with topics(ends.bootstrap_servers, [ends.source, ends.sink]):
        fill(ends.bootstrap_servers, ends.source, values)
        with contextlib.closing(EndOffset(ends.bootstrap_servers, ends.sink)) as end_offset:
            with _started(CONTESTANTS[name], ends, domain) as sides:
                first, last = _watch(end_offset, sides)
            end = end_offset()
        tally = count(ends.bootstrap_servers, ends.sink, end)
    return Result(
        name,
        number,
        len(values),
        tally.delivered,
        tally.duplicated,
        tally.out_of_order,
        max(tally.last_ms - tally.first_ms, 1) / 1000,
        *(side.side(first, last, tally.delivered) for side in sides),
    )


@contextmanager
def _started(contestant: Contestant, ends: Ends, domain: int) -> Iterator[tuple[Watched, Watched]]:
    """Start the two processes, the one that publishes last."""
    environ = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    commands = contestant.commands(ends)

    def process(name: str, command: list[str]) -> Process:
        return Process(f'{contestant.what}, {name},', command, ends.place / name, environ)

    with process('ROS -> Kafka', commands.ros_to_kafka) as ros_to_kafka:
        ros_to_kafka.wait_for(commands.subscribed, START_S)
        with process('Kafka -> ROS', commands.kafka_to_ros) as kafka_to_ros:
            yield Watched(kafka_to_ros, []), Watched(ros_to_kafka, [])


def _watch(end_offset: Callable[[], int], sides: Sequence[Watched]) -> tuple[int, int]:
    """Wait until the sink has its last record; returns the looks at its first and its last."""
    first = last = end = 0
    changed_s = time.monotonic()
    for number in itertools.count():
        for side in sides:
            side.look()
        before, end = end, end_offset()
        now_s = time.monotonic()
        if end != before:
            first, last = (first if before else number), number
            changed_s = now_s
        if now_s - changed_s > (STABLE_S if end else START_S):
            break
        time.sleep(LOOK_S if end else FIRST_LOOK_S)
    if not end:
        raise TimeoutError(f'nothing has arrived within {START_S:.0f} s')
    return first, last


# The report


def _line(result: Result) -> str:
    return (
        f'{result.contestant} {result.rate:,.0f} orders/s, {result.delivered:,} delivered, '
        f'{result.lost:,} lost'
    )


def show(results: Sequence[Result], console: Console) -> None:
    """Print the table of medians, and the ratios."""
    by_name = _by_contestant(results)
    most = max(len(of_one) for of_one in by_name.values())
    title = f'{results[0].orders:,} orders, ' + (
        'one round' if most == 1 else f'medians of {most}'
    )
    table = Table(title=title)
    table.add_column('')
    for name in by_name:
        table.add_column(name, justify='right')
    for words, read, form in _ROWS:
        table.add_row(words, *(form(map(read, of_one)) for of_one in by_name.values()))
    console.print(table)
    for words, ratios in _ratios(by_name).items():
        low, high = min(ratios), max(ratios)
        console.print(f'{words}: {statistics.median(ratios):.2f} ({low:.2f} to {high:.2f})')


def _by_contestant(results: Sequence[Result]) -> dict[str, list[Result]]:
    by_name: dict[str, list[Result]] = {}
    for result in results:
        by_name.setdefault(result.contestant, []).append(result)
    return by_name


def _ratios(by_name: dict[str, list[Result]]) -> dict[str, list[float]]:
    """Rates of the bridge by those of another in the same round."""
    bridge = by_name.get('bridge', [])
    return {
        f'bridge / {name}': [one.rate / two.rate for one, two in zip(bridge, of_one, strict=True)]
        for name, of_one in by_name.items()
        if bridge and name != 'bridge'
    }


def _whole(values: Iterator[float]) -> str:
    return f'{statistics.median(values):,.0f}'


def _tenths(values: Iterator[float]) -> str:
    return f'{statistics.median(values):,.1f}'


_ROWS: Final[Sequence[tuple[str, Callable[[Result], float], Callable[[Iterator[float]], str]]]] = (
    ('orders/s delivered', lambda r: r.rate, _whole),
    ('seconds', lambda r: r.seconds, _tenths),
    ('delivered', lambda r: r.delivered, _whole),
    ('lost', lambda r: r.lost, _whole),
    ('duplicated', lambda r: r.duplicated, _whole),
    ('out of order', lambda r: r.out_of_order, _whole),
    ('CPU µs/order, Kafka -> ROS', lambda r: r.kafka_to_ros.cpu_us, _tenths),
    ('CPU µs/order, ROS -> Kafka', lambda r: r.ros_to_kafka.cpu_us, _tenths),
    ('RssAnon MiB, Kafka -> ROS', lambda r: r.kafka_to_ros.anon_mib, _tenths),
    ('RssAnon MiB, ROS -> Kafka', lambda r: r.ros_to_kafka.anon_mib, _tenths),
)


def report(results: Sequence[Result], *, is_local_kafka: bool) -> dict[str, Any]:
    """Make what `--json` writes."""
    rounds = [
        {
            **result._asdict(),
            'lost': result.lost,
            'orders_per_s': result.rate,
            'kafka_to_ros': result.kafka_to_ros._asdict(),
            'ros_to_kafka': result.ros_to_kafka._asdict(),
        }
        for result in results
    ]
    return {
        'machine': machine()._asdict(),
        'versions': versions(is_local_kafka=is_local_kafka),
        'ratios': _ratios(_by_contestant(results)),
        'rounds': rounds,
    }


def _show_machine(report: dict[str, Any], console: Console) -> None:
    here = report['machine']
    console.print(f'{here["cores"]} cores of {here["cpu"]}, {here["memory_gib"]} GiB')
    console.print(', '.join(f'{name} {number}' for name, number in report['versions'].items()))


# The command line


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status."""
    options = _parse(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console(highlight=False)
    try:
        with _kafka(options.bootstrap_servers) as bootstrap_servers:
            results = run_rounds(options, bootstrap_servers, console.print)
    except KeyboardInterrupt:
        return 130
    except (ConfigError, TransportError, ProcessError, TimeoutError, KafkaException) as error:
        print(error, file=sys.stderr)
        return 1
    made = report(results, is_local_kafka=options.bootstrap_servers is None)
    show(results, console)
    _show_machine(made, console)
    if options.json:
        options.json.write_text(json.dumps(made, indent=2) + '\n', encoding='utf-8')
    return 0


@contextmanager
def _kafka(bootstrap_servers: str | None) -> Iterator[str]:
    if bootstrap_servers is not None:
        yield bootstrap_servers
        return
    with LocalKafka() as kafka:
        yield kafka.bootstrap_servers


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.drain', description='Drains a topic through both directions.'
    )
    parser.add_argument('--orders', type=_positive, default=ORDERS, help='default: %(default)s')
    parser.add_argument('--rounds', type=_positive, default=1, help='default: %(default)s')
    parser.add_argument(
        '--contestants',
        type=_names,
        default=list(CONTESTANTS),
        help=f'separated by commas, in turn (default: {",".join(CONTESTANTS)})',
    )
    parser.add_argument(
        '--ros-domains',
        type=lambda text: [int(word) for word in text.split(',')],
        default=DOMAINS,
        help='ROS domains, in turn (default: %(default)s)',
    )
    parser.add_argument('--json', type=Path, help='write all of it into this file, too')
    parser.add_argument('--bootstrap-servers', help='default: a Kafka is started for the run')
    return parser.parse_args(arguments)


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError('at least 1')
    return number


def _names(text: str) -> list[str]:
    names = list(dict.fromkeys(text.split(',')))
    unknown = [name for name in names if name not in CONTESTANTS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f'no contestant {unknown[0]!r}: there are {", ".join(CONTESTANTS)}'
        )
    return names


if __name__ == '__main__':
    sys.exit(main())
