"""A bridge at half its maximum rate, both ways, for minutes: does it lose, does it grow?

    python -m benchmarks.soak --minutes 10 --rate auto

One process runs both routes on a real Kafka, with default settings; what sends and counts are
processes of their own. With `--rate auto` the maximum is looked for first: the highest rate that
both ways keep up with at once, in steps. Memory is what no other process shares and no file
backs; its slope is that of a straight line through the means of ten seconds each, in the second
half, with its standard error. It has grown where the slope less two of these errors is above 16
KiB a minute, a megabyte in an hour; then what holds more than at half-time is said, too. In less
than four minutes a bridge has not settled, and nothing is said of its memory.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from confluent_kafka import Consumer, TopicPartition
from confluent_kafka.admin import AdminClient
from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.numbers import Count, Stage, staged
from benchmarks.topics import EndOffset
from benchmarks.vitals import Slope, Vitals, held, means, slope, watched
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, open_node
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

DOMAIN: Final = 220
END_S: Final = 120.0
FIRST_RATE: Final = 250.0
MOST_RATE: Final = 30_000.0
STEP: Final = 1.5
STEP_S: Final = 8.0
KEPT: Final = 0.85
BOX_S: Final = 10.0
LEAST_BOXES: Final = 12  # in the second half
LOOK_AROUND_S: Final = 15.0
WARM_UP_SHARE: Final = 0.2
MOST_KIB_PER_MIN: Final = 16.0
REQUEST_S: Final = 10.0


class Rates(NamedTuple):
    """Messages per second."""

    to_ros: float
    to_kafka: float


class Around(NamedTuple):
    """What the bridge has made elsewhere, at one moment."""

    kafka_topics: int
    ros_endpoints: int


class Way(NamedTuple):
    """What became of the numbers of one direction."""

    sent: int
    lost: int
    repeated: int


class Result(NamedTuple):
    """A soak.

    Args:
        seen: The bridge, every second.
        around: What stood in Kafka and in the ROS graph, after the warm-up and to the end.
        warm_up_s: What does not count for the slope.
        held: What held the memory of the bridge at half-time and at the end, in KiB.
        behind: Records that were still to be read when the sending ended: with many of them the
            bridge did not keep up, its queues were full, and the slope tells little.
        status: Of the bridge at its end.
    """

    rates: Rates
    seen: list[Vitals]
    around: list[Around]
    warm_up_s: float
    held: tuple[Mapping[str, int], Mapping[str, int]]
    behind: int
    to_ros: Way
    to_kafka: Way
    status: int

    @property
    def warm(self) -> list[Vitals]:
        """What was seen after the warm-up."""
        return [one for one in self.seen if one.at_s - self.seen[0].at_s >= self.warm_up_s]

    @property
    def memory(self) -> Slope:
        """KiB per minute, in the second half."""
        half_s = (self.seen[0].at_s + self.seen[-1].at_s) / 2
        late = [(one.at_s / 60, float(one.anon_kib)) for one in self.seen if one.at_s >= half_s]
        boxes = means(late, BOX_S / 60)
        return slope(boxes) if len(boxes) >= LEAST_BOXES else Slope(math.nan, math.nan)

    @property
    def holders(self) -> list[str]:
        """What held more memory at the end than at half-time."""
        half, end = self.held
        more = sorted(((end[kind] - half.get(kind, 0), kind) for kind in end), reverse=True)
        return [f'{kind} {kib:+,} KiB' for kib, kind in more if kib > 0]

    @property
    def grown(self) -> list[str]:
        """What there was more of at the end than after the warm-up; memory since half-time."""
        first, last = self.warm[0], self.warm[-1]
        around, then = self.around[0], self.around[-1]
        pairs = {
            'threads': (first.threads, last.threads),
            'descriptors': (first.descriptors, last.descriptors),
            'Kafka topics': (around.kafka_topics, then.kafka_topics),
            'ROS endpoints': (around.ros_endpoints, then.ros_endpoints),
        }
        grown = [f'{name} ({a} to {b})' for name, (a, b) in pairs.items() if b > a]
        if self.memory.least > MOST_KIB_PER_MIN:
            grown.append(f'memory ({", ".join(self.holders)})')
        return grown

    @property
    def sound(self) -> bool:
        """Whether all arrived once, the bridge ended well, and nothing that is counted grew."""
        all_came = not any((*self.to_ros[1:], *self.to_kafka[1:]))
        return all_came and not self.grown and self.status == 0


@contextmanager
def _staged(servers: str) -> Iterator[Stage]:
    with (
        tempfile.TemporaryDirectory(prefix='soak-') as place,
        staged(servers, Path(place), DOMAIN, 'soak') as stage,
    ):
        yield stage


def most(servers: str) -> float:
    """Find the highest rate that both ways keep up with at once, to a factor of `STEP`."""
    rate, kept = FIRST_RATE, 0.0
    with _staged(servers) as stage:
        while rate <= MOST_RATE:
            with stage.senders(rate, rate):
                time.sleep(STEP_S / 4)
                before, since_s = _delivered(stage), time.monotonic()
                time.sleep(STEP_S)
                after, seconds = _delivered(stage), time.monotonic() - since_s
            if any(b - a < KEPT * rate * seconds for a, b in zip(before, after, strict=True)):
                break
            rate, kept = STEP * rate, rate
    if not kept:
        raise TimeoutError(f'the bridge does not keep up with {FIRST_RATE:.0f} messages/s')
    return kept


def _delivered(stage: Stage) -> tuple[int, int]:
    """How many messages have been confirmed, each way; to ROS as far as is committed."""
    source = TopicPartition(f'{stage.mark}.source', 0)
    config = {'bootstrap.servers': stage.servers, 'group.id': 'numbers.to_ros'}
    with (
        closing(Consumer(config)) as consumer,
        closing(EndOffset(stage.servers, f'{stage.mark}.sink')) as end_offset,
    ):
        [committed] = consumer.committed([source], timeout=REQUEST_S)
        return max(0, committed.offset), end_offset()


def soak(servers: str, rates: Rates, minutes: float) -> Result:
    """Run for so long at these rates, and count."""
    around: list[Around] = []
    half: Mapping[str, int] = {}  # memory at half-time
    warm_up_s = WARM_UP_SHARE * minutes * 60
    with _staged(servers) as stage, open_node('soak', DOMAIN, Histories({}, {}, None)) as node:
        with (
            watched(lambda: stage.bridge.pid) as seen,
            stage.senders(*rates) as senders,
        ):
            begun_s = time.monotonic()
            while (elapsed_s := time.monotonic() - begun_s) < minutes * 60:
                stage.bridge.check()
                time.sleep(min(LOOK_AROUND_S, minutes * 60 - elapsed_s))
                if time.monotonic() - begun_s >= warm_up_s:
                    around.append(_look_around(servers, node))
                if not half and time.monotonic() - begun_s >= minutes * 30:
                    half = held(stage.bridge.pid)
            end_held = held(stage.bridge.pid)
            seen = list(seen)  # noqa: PLW2901 -- what comes now is the end
            sent = senders.end()
        behind = sent[0] - _delivered(stage)[0]
        end = _wait_for_all(stage, sent)
        status = stage.bridge.end(END_S)
        arrived = stage.counted()
        in_kafka = stage.counted_in_kafka(end)
    return Result(
        rates,
        seen,
        around,
        warm_up_s,
        (half, end_held),
        behind,
        _way(sent[0], arrived),
        _way(sent[1], in_kafka),
        status,
    )


def _way(sent: int, count: Count) -> Way:
    return Way(sent, count.lost(sent), count.repeated)


def _wait_for_all(stage: Stage, sent: Sequence[int]) -> int:
    """Wait until all has been delivered, or nothing more comes; returns the end of the sink."""
    done, changed_s = _delivered(stage), time.monotonic()
    while done != tuple(sent) and time.monotonic() - changed_s < END_S:
        before, done = done, _delivered(stage)
        changed_s = time.monotonic() if done != before else changed_s
        time.sleep(0.5)
    return done[1]


def _look_around(servers: str, node: RosNode) -> Around:
    admin = AdminClient({'bootstrap.servers': servers, 'log_level': 3})
    found = admin.list_topics(timeout=REQUEST_S).topics
    ends = sum(len(topic.publishers) + len(topic.subscribers) for topic in node.topics())
    return Around(len(found), ends)


# The report


def show(result: Result, console: Console) -> None:
    """Print the table."""
    table = Table('way', 'messages/s', 'sent', 'lost', 'repeated')
    for name in Rates._fields:
        way, rate = getattr(result, name), getattr(result.rates, name)
        table.add_row(name, f'{rate:,.0f}', f'{way.sent:,}', f'{way.lost:,}', f'{way.repeated:,}')
    console.print(table)
    if result.behind > result.rates.to_ros:
        console.print(f'it did not keep up: {result.behind:,} records behind at the end')
    warm, memory = result.warm, result.memory
    last = warm[-1]
    console.print(
        f'memory: {warm[0].anon_kib / 1024:.1f} MiB after the warm-up, '
        f'{last.anon_kib / 1024:.1f} at the end, '
        f'{max(one.anon_kib for one in result.seen) / 1024:.1f} at most; '
        + (
            'too short to tell whether it grows'
            if math.isnan(memory.error)
            else f'{memory.per_x:+.1f} KiB/min in the second half, '
            f'standard error {memory.error:.1f}'
        )
    )
    console.print(
        f'{last.threads} threads, {last.descriptors} descriptors, '
        f'{result.around[-1].kafka_topics} Kafka topics, '
        f'{result.around[-1].ros_endpoints} ROS endpoints; '
        + (f'grown: {", ".join(result.grown)}' if result.grown else 'none has grown')
    )


def report(result: Result, _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {
        'rates': result.rates._asdict(),
        'to_ros': result.to_ros._asdict(),
        'to_kafka': result.to_kafka._asdict(),
        'memory_kib_per_min': result.memory.per_x,
        'memory_kib_per_min_error': result.memory.error,
        'warm_up_s': result.warm_up_s,
        'held_kib': result.held,
        'behind': result.behind,
        'grown': result.grown,
        'status': result.status,
        'around': [one._asdict() for one in result.around],
        'seen': [
            {**one._asdict(), 'at_s': round(one.at_s - result.seen[0].at_s, 1)}
            for one in result.seen
        ],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Soak and print; returns the exit status: 1 where something was lost, or has grown."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.soak',
        description='Runs a bridge at half its maximum rate, and looks whether it grows.',
    )
    parser.add_argument('--minutes', type=float, default=10.0, help='default: %(default)s')
    parser.add_argument(
        '--rate',
        type=_rate,
        default='auto',
        help='messages per second each way; auto: half of what it carries (default)',
    )
    return run(parser, arguments, _measure, show, report, lambda result: result.sound)


def _measure(options: argparse.Namespace, console: Console) -> Result:
    with LocalKafka() as kafka:
        rates = options.rate
        if rates is None:
            full = most(kafka.bootstrap_servers)
            console.print(f'both ways keep up with {full:,.0f} messages/s each')
            rates = Rates(full / 2, full / 2)
        return soak(kafka.bootstrap_servers, rates, options.minutes)


def _rate(text: str) -> Rates | None:
    return None if text == 'auto' else Rates(float(text), float(text))


if __name__ == '__main__':
    sys.exit(main())
