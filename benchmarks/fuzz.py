"""Fuzzed records through a bridge: none ends it, each is delivered or dead-lettered.

    python -m benchmarks.fuzz --records 1000000 --seed 1

Half of them go through a route with `format: text`, half through one with `format: cdr`: random
bytes, changed CDR, NULs, bad UTF-8, nulls, headers with names of any bytes, keys and headers
without measure, sizes around the limits (`benchmarks/hostile.py`). A reader keeps a hash of all
that arrives. In the end each offset of the topic is looked for: it has a dead letter, or what
its record says has arrived. The same seed makes the same records.
"""

import argparse
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from confluent_kafka import Consumer, KafkaException, TopicPartition
from rich.console import Console
from rich.table import Table

from benchmarks.command import run
from benchmarks.hostile import CDR_TYPE, LIMIT_BYTES, TEXT_TYPE, Hostile, messages, texts
from benchmarks.processes import programs
from benchmarks.raw_producer import RawProducer
from benchmarks.topics import topics
from benchmarks.vitals import watched
from rig.peers.subscriber import DIGEST_BYTES, digest
from rig.processes import Process, ProcessError, direct
from rig.topics import records
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

SCOPE = Scope('topic')
DOMAIN: Final = 219
START_S: Final = 60.0
STALL_S: Final = 120.0
LOOK_S: Final = 0.5
QUIET_S: Final = 5.0
REQUEST_S: Final = 10.0
TOPIC_LIMIT_BYTES: Final = 5_000_000

FILE: Final = """\
name: fuzz
kafka: {{bootstrap.servers: '{servers}'}}
routes:
  - name: text
    from: {{kafka: {mark}.text, start: earliest}}
    to: {{ros: /text_{mark}, type: {text_type}}}
    format: text
  - name: cdr
    from: {{kafka: {mark}.cdr, start: earliest}}
    to: {{ros: /cdr_{mark}, type: {cdr_type}}}
    format: cdr
"""


class Result(NamedTuple):
    """What became of the records of one route.

    Args:
        lost: Neither delivered nor dead-lettered.
        unexpected: Delivered, and no record says so; also what came twice.
        wrong: Delivered, though a text that ROS cannot hold, or dead-lettered, though it can.
    """

    route: str
    records: int
    delivered: int
    dead_letters: int
    dead_letters_twice: int
    lost: int
    unexpected: int
    wrong: int

    @property
    def sound(self) -> bool:
        """Whether every record came to its end once."""
        return not (self.lost or self.unexpected or self.wrong or self.dead_letters_twice)


class Outcome(NamedTuple):
    """What became of all, and of the bridge.

    Args:
        seconds: From the start of the bridge until the last offset was committed.
        bug: The last lines of the bridge where it ended of itself; empty if it did not.
    """

    results: list[Result]
    seconds: float
    peak_mib: float
    bug: str

    @property
    def records_per_s(self) -> float:
        """Records of both routes."""
        return sum(result.records for result in self.results) / self.seconds

    @property
    def sound(self) -> bool:
        """Whether the bridge lives and every record came to its end once."""
        return not self.bug and all(result.sound for result in self.results)


class Lane(NamedTuple):
    """One route: its records, as often as they are asked for, and what can be said of them."""

    name: str
    message_type: str
    total: int
    records: Callable[[], Iterator[Hostile]]
    expected: Callable[[Hostile], bool | None]


def lanes(seed: int, count: int) -> list[Lane]:
    """Make both routes of `count` records together."""
    half = count // 2
    return [
        Lane('text', TEXT_TYPE, half, lambda: texts(seed, half), _is_text),
        Lane(
            'cdr', CDR_TYPE, count - half,
            lambda: messages(seed + 1, count - half, _valid()), lambda _: None,
        ),
    ]  # fmt: skip


def _is_text(record: Hostile) -> bool:
    """Whether a String can hold it; told without the code of the bridge."""
    value = record.value
    if value is None or len(value) > LIMIT_BYTES or b'\0' in value:
        return False
    try:
        value.decode()
    except UnicodeDecodeError:
        return False
    return True


@cache
def _valid() -> Sequence[bytes]:
    """Messages with numbers, texts, bools and messages inside, empty, small, and too large."""
    from rclpy.serialization import serialize_message  # noqa: PLC0415 (heavy)
    from test_msgs.msg import BasicTypes, UnboundedSequences  # noqa: PLC0415

    some = UnboundedSequences(
        bool_values=[True, False, True],
        byte_values=[b'\x01', b'\xff'],
        float64_values=[1.5, -2.25],
        int16_values=[1, 2, 3],
        uint64_values=[2**64 - 1],
        string_values=['', 'abc', '\u00e9\u4e16'],
        basic_types_values=[BasicTypes(bool_value=True, float64_value=1.0), BasicTypes()],
    )
    numbers = UnboundedSequences(int8_values=list(range(-100, 100)), float32_values=[0.5] * 7)
    texts = UnboundedSequences(string_values=[f'text {number}' for number in range(20)])
    large = UnboundedSequences(string_values=['x' * 100] * (LIMIT_BYTES // 100))
    made = (UnboundedSequences(), some, numbers, texts, large)
    return [bytes(serialize_message(message)) for message in made]


# The run


def play(servers: str, place: Path, domain: int, seed: int, count: int) -> Outcome:
    """Send the records, run a bridge over them, and look for each.

    Args:
        servers: Of a Kafka.
        place: A directory for files.
        domain: ROS domain.
        seed: Of the records.
        count: How many, in both routes together.
    """
    mark = f'fuzz_{uuid.uuid4().hex[:8]}'
    both = lanes(seed, count)
    file = place / 'fuzz.yaml'
    file.write_text(
        FILE.format(servers=servers, mark=mark, text_type=TEXT_TYPE, cdr_type=CDR_TYPE)
    )
    at = programs(place, domain)
    with ExitStack() as stack:
        names = [f'{mark}.{lane.name}' for lane in both]
        stack.enter_context(topics(servers, names, max_message_bytes=str(TOPIC_LIMIT_BYTES)))
        for lane in both:
            with RawProducer(servers) as producer:
                for key, value, headers in lane.records():
                    producer.produce(f'{mark}.{lane.name}', value, key, headers)
        for lane in both:
            words = f'/{lane.name}_{mark}', str(place / lane.name), '--type', lane.message_type
            reader = at.peer(f'reader of {lane.name}', 'subscriber', *words, '--form', 'hash')
            stack.enter_context(reader).wait_for('ready', START_S)
        bridge = programs(place, domain, direct).bridge('bridge', file)
        begun_s = time.monotonic()
        with bridge, watched(lambda: bridge.pid, LOOK_S) as seen:
            bug = _wait_until_read(servers, mark, both, bridge)
            seconds = time.monotonic() - begun_s
        letters = {lane.name: _letters(servers, f'{mark}.{lane.name}') for lane in both}
        arrived = {lane.name: _arrived(place / lane.name) for lane in both}
    results = [_result(lane, letters[lane.name], arrived[lane.name]) for lane in both]
    return Outcome(results, seconds, max(vitals.anon_kib for vitals in seen) / 1024, bug)


def _wait_until_read(servers: str, mark: str, both: Sequence[Lane], bridge: Process) -> str:
    """Wait until every offset is committed; returns what the bridge said if it ended first."""
    done: dict[str, int] = {}
    moved_s = time.monotonic()
    while any(done.get(lane.name, 0) < lane.total for lane in both):
        try:
            bridge.check()
        except ProcessError as error:
            return str(error)
        now = {lane.name: _committed(servers, mark, lane.name) for lane in both}
        if now != done:
            done, moved_s = now, time.monotonic()
        if time.monotonic() - moved_s > STALL_S:
            raise TimeoutError(f'nothing moves: {done} records are done')
        time.sleep(LOOK_S)
    return ''


def _committed(servers: str, mark: str, lane: str) -> int:
    config = {'bootstrap.servers': servers, 'group.id': f'fuzz.{lane}'}
    here = TopicPartition(f'{mark}.{lane}', 0)
    with closing(Consumer(config)) as consumer, suppress(KafkaException):  # busy: asked again
        [answer] = consumer.committed([here], timeout=REQUEST_S)
        return max(0, int(answer.offset))
    return 0


# The count


def _letters(servers: str, topic: str) -> Counter[int]:
    """How many dead letters each offset has."""
    found: Counter[int] = Counter()
    for record in records(servers, f'{topic}.dead-letters'):
        told: dict[str, Any] = dict(record.headers() or [])  # forged ones come first
        found[int(told['dead_letter.offset'])] += 1
    return found


def _arrived(file: Path) -> Counter[bytes]:
    """The hashes of all that a reader has got, once no more come."""
    size, changed_s = -1, time.monotonic()
    while time.monotonic() - changed_s < QUIET_S:
        if file.stat().st_size != size:
            size, changed_s = file.stat().st_size, time.monotonic()
        time.sleep(LOOK_S)
    data = file.read_bytes()
    return Counter(data[at : at + DIGEST_BYTES] for at in range(0, len(data), DIGEST_BYTES))


def _result(lane: Lane, letters: Counter[int], arrived: Counter[bytes]) -> Result:
    decode = FORMATS[lane.name].make_decode(load_type(lane.message_type).layout, SCOPE)
    delivered = sum(arrived.values())
    lost = wrong = 0
    for offset, record in enumerate(lane.records()):
        is_dead = offset in letters
        expected = lane.expected(record)
        wrong += expected is not None and expected == is_dead
        if not is_dead:
            lost += not _taken_from(arrived, decode, record.value)
    twice = sum(count - 1 for count in letters.values())
    return Result(
        lane.name, lane.total, delivered, len(letters), twice, lost, arrived.total(), wrong
    )


def _taken_from(
    arrived: Counter[bytes], decode: Callable[[bytes | None], bytes], value: bytes | None
) -> bool:
    try:
        one = digest(decode(value))
    except RecordError:
        return False
    if not arrived[one]:
        return False
    arrived[one] -= 1
    return True


# The report


def show(outcome: Outcome, console: Console) -> None:
    """Print the table."""
    table = Table(*('route', 'records', 'delivered', 'dead letters', 'lost', 'wrong', 'twice'))
    for one in outcome.results:
        twice = one.unexpected + one.dead_letters_twice
        numbers = (one.records, one.delivered, one.dead_letters, one.lost, one.wrong, twice)
        table.add_row(one.route, *(f'{number:,}' for number in numbers))
    console.print(table)
    console.print(
        f'{outcome.records_per_s:,.0f} records/s, {outcome.peak_mib:.0f} MiB at most; the bridge '
        + (f'ended: {outcome.bug}' if outcome.bug else 'lives')
    )


def report(outcome: Outcome, options: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    return {
        'seed': options.seed,
        'records_per_s': outcome.records_per_s,
        'seconds': outcome.seconds,
        'peak_mib': outcome.peak_mib,
        'bug': outcome.bug,
        'routes': [result._asdict() for result in outcome.results],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; returns the exit status: 1 where a record was lost or the bridge ended."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.fuzz', description='Sends fuzzed records through a bridge.'
    )
    parser.add_argument('--records', type=int, default=1_000_000, help='default: %(default)s')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    return run(parser, arguments, _measure, show, report, lambda outcome: outcome.sound)


def _measure(options: argparse.Namespace, _: Console) -> Outcome:
    with LocalKafka() as kafka, tempfile.TemporaryDirectory(prefix='fuzz-') as place:
        return play(kafka.bootstrap_servers, Path(place), DOMAIN, options.seed, options.records)


if __name__ == '__main__':
    sys.exit(main())
