"""Subscribers and publishers that come and go: does the bridge go on, does it grow?

    python -m benchmarks.churn --times 1000

One process runs a route each way, with a steady reader and a steady publisher. Beside them others
come and go on the same topics, with every QoS, as nodes of one process and as processes, one of
25 killed. In the end all of the steady ones' numbers are looked for. A reader that goes makes the
bridge publish again what it had not acknowledged: so the steady reader may get repeats.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.numbers import Count, staged
from benchmarks.topics import EndOffset
from benchmarks.vitals import Slope, Vitals, slope, vitals
from rig.processes import Process, Programs
from ros2_kafka_bridge.ros.fastdds_profile import FASTDDS_3, Histories, make_profile
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

DOMAIN: Final = 221
START_S: Final = 60.0
END_S: Final = 180.0
VISITS_S: Final = 300.0
ROUND: Final = 25
"""Visits between two looks at the bridge; the last of them is a process that is killed."""

RATE: Final = 100.0
LEASE_S: Final = 2.0  # of the visitors: a killed one holds the bridge back for so long
WARM_UP_SHARE: Final = 0.2


class Result(NamedTuple):
    """What came of it.

    Args:
        seen: The bridge after each round of visits, the first one before them.
        sent: Numbers of the steady ones: to ROS, to Kafka.
        status: Of the bridge at its end.
    """

    visits: int
    killed: int
    seen: list[Vitals]
    sent: tuple[int, int]
    arrived: tuple[Count, Count]
    status: int

    @property
    def lost(self) -> int:
        """Numbers of the steady ones that have not arrived, of both ways."""
        return sum(count.lost(sent) for sent, count in zip(self.sent, self.arrived, strict=True))

    def growth(self, name: str) -> Slope:
        """How much of something there is more after each visit, without the first fifth."""
        warm = int(len(self.seen) * WARM_UP_SHARE)
        points = enumerate(self.seen)
        return slope([(at * ROUND, float(getattr(one, name))) for at, one in points][warm:])


def play(servers: str, place: Path, domain: int, times: int) -> Result:
    """Let others come and go beside a bridge.

    Args:
        servers: Of a Kafka.
        place: A directory for files.
        domain: ROS domain.
        times: How often.
    """
    with (
        staged(servers, place, domain, 'churn', '{drain_s: 60}') as stage,
        stage.senders(RATE, RATE) as senders,
    ):
        bridge = stage.bridge
        seen = [vitals(bridge.pid)]
        visitors = _Visitors(stage.at, f'/to_ros_{stage.mark}', f'/to_kafka_{stage.mark}')
        for first in range(0, times, ROUND):
            visitors.come_and_go(min(ROUND, times - first), seed=first)
            bridge.check()
            seen.append(vitals(bridge.pid))
        sent = senders.end()
        status = bridge.end(END_S)
        there = stage.counted()
        with closing(EndOffset(servers, f'{stage.mark}.sink')) as end_offset:
            in_kafka = stage.counted_in_kafka(end_offset())
    return Result(times, visitors.killed, seen, sent, (there, in_kafka), status)


class _Visitors:
    """Processes whose nodes come and go."""

    def __init__(self, at: Programs, *topics: str) -> None:
        profile = at.logs / 'visitor.xml'
        profile.write_text(make_profile(Histories({}, {}, LEASE_S)))
        self._at = at
        self._profile = {FASTDDS_3.variable: str(profile)}
        self._command = ['-m', 'benchmarks.visitor', *topics]
        self.killed = 0

    def come_and_go(self, times: int, seed: int) -> None:
        """So often, the last time by a kill."""
        with self._visitor('visitor', seed, '--times', str(times - 1)) as visitor:
            visitor.wait_for(f'gone {times - 1}', VISITS_S)
        with self._visitor('killed', seed, '--stay') as visitor:
            visitor.wait_for('ready', START_S)
            visitor.kill()
        self.killed += 1

    def _visitor(self, name: str, seed: int, *words: str) -> Process:
        words = *self._command, *words, '--seed', str(seed)
        return self._at.python(f'{name}-{seed}', *words, **self._profile)


# The report


def show(result: Result, console: Console) -> None:
    """Print the table."""
    table = Table('of the bridge', 'before', 'at the end', 'per visit', 'standard error')
    for name in ('anon_kib', 'threads', 'descriptors'):
        first, last = getattr(result.seen[0], name), getattr(result.seen[-1], name)
        growth = result.growth(name)
        table.add_row(
            name.replace('anon_kib', 'memory, KiB'), f'{first:,}', f'{last:,}',
            f'{growth.per_x:+.3f}', f'{growth.error:.3f}',
        )  # fmt: skip
    console.print(table)
    for name, sent, count in zip(('ROS', 'Kafka'), result.sent, result.arrived, strict=True):
        console.print(
            f'steady, to {name}: {sent:,} sent, {count.lost(sent):,} lost, '
            f'{count.repeated:,} repeated; of visitors: {count.others:,}'
        )
    console.print(f'{result.visits:,} visits, {result.killed} killed; status {result.status}')


def report(result: Result, _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {
        'visits': result.visits,
        'killed': result.killed,
        'sent': result.sent,
        'lost': result.lost,
        'arrived': [count._asdict() for count in result.arrived],
        'status': result.status,
        'per_visit': {
            name: result.growth(name)._asdict() for name in ('anon_kib', 'threads', 'descriptors')
        },
        'seen': [one._asdict() for one in result.seen],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Come and go, and print; returns the exit status: 1 where a number was lost."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.churn', description='Lets ROS nodes come and go at a bridge.'
    )
    parser.add_argument('--times', type=int, default=1000, help='default: %(default)s')
    return run(parser, arguments, _measure, show, report, lambda it: not (it.lost or it.status))


def _measure(options: argparse.Namespace, _: Console) -> Result:
    with LocalKafka() as kafka, tempfile.TemporaryDirectory(prefix='churn-') as place:
        return play(kafka.bootstrap_servers, Path(place), DOMAIN, options.times)


if __name__ == '__main__':
    sys.exit(main())
