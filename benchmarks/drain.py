"""How fast a topic of orders drains through both directions: Kafka -> ROS -> Kafka.

    python -m benchmarks.drain --rounds 3

Three contestants take turns in one run, each on topics and in a ROS domain of its own, each with
one process for each direction: `paper`, `bridge` and `bare` (see `contestants`). A fourth shows
what it costs to watch the bridge, and its metrics are read each second:

    python -m benchmarks.drain --rounds 5 --contestants bridge,monitored

The source topic is full before they start. Measured is the time between the first and the last
record in the sink topic, by the broker's clock; what arrived is counted afterwards, so that no
reader takes part in the race. CPU time is per delivered order, from the first record on. How long
the first one takes from the start of the process that publishes (the other one has subscribed) is
start-up, and shown apart.
"""

import argparse
import contextlib
import itertools
import sys
import tempfile
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console

from benchmarks.command import run
from benchmarks.contestants import CONTESTANTS, Commands, Ends
from benchmarks.drain_table import Result, Side, report, show
from benchmarks.options import broker, domains, some_of, whole_number
from benchmarks.processes import Usage, of_family, programs
from benchmarks.topics import EndOffset, count, fill, topics
from rig.processes import Process, direct
from ros2_kafka_bridge.testing.orders import encode, orders

ORDERS: Final = 150_000
SEED: Final = 1
DOMAINS: Final = (215, 216, 217)
DEFAULT: Final = ('paper', 'bridge', 'bare')
PAGE_S: Final = 1.0
START_S: Final = 60.0
FIRST_LOOK_S: Final = 0.02
LOOK_S: Final = 0.2
STABLE_S: Final = 3.0


class Pages:
    """What is asked for each second meanwhile, as a Prometheus does it."""

    def __init__(self, addresses: Sequence[str]) -> None:
        self._addresses = addresses
        self._at_s = time.monotonic() + PAGE_S

    def look(self) -> None:
        """Ask, if it is time for that; one that does not listen yet is left out."""
        now_s = time.monotonic()
        if now_s >= self._at_s:
            self._at_s = now_s + PAGE_S
            for address in self._addresses:
                with contextlib.suppress(urllib.error.URLError):
                    _read(address)


def _read(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=START_S) as page:  # noqa: S310 (http)
        return bytes(page.read())


class Watched(NamedTuple):
    """A process, and what was seen of it."""

    process: Process
    seen: list[Usage]

    def look(self) -> None:
        """Note what it has used, with its children."""
        self.process.check()
        self.seen.append(of_family(self.process.pid))

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
            commands = CONTESTANTS[name].commands(ends)
            with _started(CONTESTANTS[name].what, commands, ends.place, domain) as sides:
                start_s, first, last = watch(end_offset, sides, Pages(commands.pages))
            end = end_offset()
        tally = count(ends.bootstrap_servers, ends.sink, end)
    return Result(
        name,
        number,
        len(values),
        tally.delivered,
        tally.duplicated,
        tally.out_of_order,
        start_s,
        max(tally.last_ms - tally.first_ms, 1) / 1000,
        *(side.side(first, last, tally.delivered) for side in sides),
    )


@contextmanager
def _started(
    what: str, commands: Commands, place: Path, domain: int
) -> Iterator[tuple[Watched, Watched]]:
    """Start the two processes, the one that publishes last."""
    at = programs(place, domain, direct)

    def process(name: str, command: list[str]) -> Process:
        return at.command(f'{what}, {name}', *command)

    with process('ROS -> Kafka', commands.ros_to_kafka) as ros_to_kafka:
        ros_to_kafka.wait_for(commands.subscribed, START_S)
        with process('Kafka -> ROS', commands.kafka_to_ros) as kafka_to_ros:
            yield Watched(kafka_to_ros, []), Watched(ros_to_kafka, [])


def watch(
    end_offset: Callable[[], int], sides: Sequence[Watched], pages: Pages
) -> tuple[float, int, int]:
    """Wait for the last record of the sink.

    Returns:
        Seconds until its first one, and the looks before that and at its last.
    """
    for side in sides:
        side.look()
    first = last = end = 0
    start_s = 0.0
    begun_s = changed_s = time.monotonic()
    for number in itertools.count(1):
        before, end = end, end_offset()
        for side in sides:  # behind the offset, so that what it took to come so far is seen
            side.look()
        now_s = time.monotonic()
        if end != before:
            if not before:
                start_s, first = now_s - begun_s, number - 1
            last, changed_s = number, now_s
        if now_s - changed_s > (STABLE_S if end else START_S):
            break
        pages.look()
        time.sleep(LOOK_S if end else FIRST_LOOK_S)
    if not end:
        raise TimeoutError(f'nothing has arrived within {START_S:.0f} s')
    return start_s, first, last


def _line(result: Result) -> str:
    return (
        f'{result.contestant} {result.rate:,.0f} orders/s, {result.delivered:,} delivered, '
        f'{result.lost:,} lost'
    )


# The command line


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.drain', description='Drains a topic through both directions.'
    )
    parser.add_argument('--orders', type=whole_number, default=ORDERS, help='default: %(default)s')
    parser.add_argument('--rounds', type=whole_number, default=1, help='default: %(default)s')
    parser.add_argument(
        '--contestants',
        type=some_of(CONTESTANTS),
        default=list(DEFAULT),
        help=f'of {", ".join(CONTESTANTS)}: separated by commas, in turn (default: '
        f'{",".join(DEFAULT)})',
    )
    parser.add_argument(
        '--ros-domains',
        type=domains,
        default=DOMAINS,
        help='ROS domains, in turn (default: %(default)s)',
    )
    parser.add_argument('--bootstrap-servers', help='default: a Kafka is started for the run')
    return run(parser, arguments, _measure, show, report, says_versions=True)


def _measure(options: argparse.Namespace, console: Console) -> list[Result]:
    with broker(options.bootstrap_servers) as kafka:
        return run_rounds(options, kafka.bootstrap_servers, console.print)


if __name__ == '__main__':
    sys.exit(main())
