"""How long a message takes from CDR to a record and back, format by format.

    python -m benchmarks.formats --rounds 20

All contestants take turns in one process, round after round, and the median of their CPU time
is told: the formats of the bridge; `usual`, rclpy's message object and a dict by its fields;
`rosbridge`, that bridge's conversion. `cdr` is the limit: it looks at the bytes and makes
nothing. Before anything is measured, each has to bring every message back as it was.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from rclpy.serialization import deserialize_message
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.formats import rosbridge, usual
from benchmarks.formats.samples import Sample, samples
from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope

TURN_S: Final = 0.02
ENOUGH_S: Final = 3.0
LEAST_ROUNDS: Final = 3
REQUIRED: Final = 5.0
REQUIRED_OF: Final = 'Odometry'


class Contestant(NamedTuple):
    """One way to write a message into a record and to read it."""

    name: str
    to_record: Callable[[bytes], bytes | None]
    to_message: Callable[[bytes], bytes]


class Result(NamedTuple):
    """What one contestant needs for one message.

    Args:
        to_record_us: Microseconds of ROS -> Kafka, the median of all rounds.
        to_message_us: Microseconds of Kafka -> ROS.
    """

    message: str
    cdr_bytes: int
    contestant: str
    record_bytes: int
    to_record_us: float
    to_message_us: float


def contestants(sample: Sample) -> Iterator[Contestant]:
    """All that can carry the message."""
    scope = Scope('benchmark', schema=SchemaSettings(registry=False))
    for name in ('cdr', 'json', 'avro', 'protobuf'):
        if name in FORMATS:
            made = FORMATS[name]
            yield Contestant(
                name,
                made.make_encode(sample.layout, scope),
                made.make_decode(sample.layout, scope),
            )
    for other in (usual, rosbridge):
        yield Contestant(
            other.__name__.rpartition('.')[2],
            other.make_to_record(sample.python_class),
            other.make_to_message(sample.python_class),
        )


def check(contestant: Contestant, sample: Sample) -> bytes:
    """Let a message go there and back; returns the record."""
    record = contestant.to_record(sample.cdr)
    assert record is not None
    back = deserialize_message(contestant.to_message(record), sample.python_class)
    if back != deserialize_message(sample.cdr, sample.python_class):
        raise AssertionError(f'{contestant.name} changes {sample.what}')
    return record


def measure(sample: Sample, rounds: int) -> list[Result]:
    """Let all take turns."""
    all_of_them = list(contestants(sample))
    records = [check(contestant, sample) for contestant in all_of_them]
    turns: list[tuple[Callable[[bytes], object], bytes]] = []
    for contestant, record in zip(all_of_them, records, strict=True):
        turns += [(contestant.to_record, sample.cdr), (contestant.to_message, record)]
    times = [_times_in(TURN_S, *turn) for turn in turns]
    seconds: list[list[float]] = [[] for _ in turns]
    for done in range(rounds):
        for number, (convert, value) in enumerate(turns):
            if done < LEAST_ROUNDS or sum(seconds[number]) * times[number] < ENOUGH_S:
                seconds[number].append(_seconds(convert, value, times[number]))
    medians = [1e6 * statistics.median(found) for found in seconds]
    return [
        Result(
            sample.what,
            len(sample.cdr),
            contestant.name,
            len(record),
            medians[2 * number],
            medians[2 * number + 1],
        )
        for number, (contestant, record) in enumerate(zip(all_of_them, records, strict=True))
    ]


def _times_in(seconds: float, convert: Callable[[bytes], object], value: bytes) -> int:
    """How often it can be called in so many seconds."""
    for _ in range(3):
        once = _seconds(convert, value, 1)
    return max(1, int(seconds / once))


def _seconds(convert: Callable[[bytes], object], value: bytes, times: int) -> float:
    begun = time.thread_time()
    for _ in range(times):
        convert(value)
    return (time.thread_time() - begun) / times


# The report


def show(results: Sequence[Result], console: Console) -> None:
    """Print a table for each message, and what json is beside the usual way."""
    for message in dict.fromkeys(result.message for result in results):
        own = [result for result in results if result.message == message]
        [base] = [result for result in own if result.contestant == 'usual']
        title = f'{message}: {own[0].cdr_bytes:,} bytes'
        table = Table(title=title, title_justify='left', box=SIMPLE_HEAD, padding=(0, 0))
        table.add_column('format', min_width=9)
        heads = ('µs to Kafka', 'MB/s', 'x usual', 'µs to ROS', 'MB/s', 'x usual', 'bytes')
        for head in heads:
            table.add_column(head, justify='right')
        for result in own:
            table.add_row(result.contestant, *_numbers(result, base), f'{result.record_bytes:,}')
        console.print(table)
    found = ratio(results, REQUIRED_OF)
    console.print(f'{REQUIRED_OF} as json: {found:.1f} times as fast as the usual way')


def _numbers(result: Result, base: Result) -> Iterator[str]:
    for mine, usually in (
        (result.to_record_us, base.to_record_us),
        (result.to_message_us, base.to_message_us),
    ):
        yield _short(mine)
        yield f'{result.cdr_bytes / mine:,.0f}'
        yield _short(usually / mine)


def _short(number: float) -> str:
    return f'{number:,.1f}' if number < 1000 else f'{number:,.0f}'


def ratio(results: Sequence[Result], message: str) -> float:
    """How many times as fast as the usual way json is, in its slower direction."""
    [mine] = [one for one in results if one.message == message and one.contestant == 'json']
    [base] = [one for one in results if one.message == message and one.contestant == 'usual']
    return min(base.to_record_us / mine.to_record_us, base.to_message_us / mine.to_message_us)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status: 1 where json is not fast enough."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.formats', description='Measures the formats.'
    )
    parser.add_argument('--rounds', type=int, default=15, help='default: %(default)s')
    return run(
        parser,
        arguments,
        lambda options, _: [it for one in samples() for it in measure(one, options.rounds)],
        show,
        lambda results, _: {'results': [result._asdict() for result in results]},
        lambda results: ratio(results, REQUIRED_OF) >= REQUIRED,
        has_kafka=False,
    )


if __name__ == '__main__':
    sys.exit(main())
