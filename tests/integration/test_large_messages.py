"""Messages of a megabyte whose sink stands still: what waits, what is dropped, what is said."""

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.bridges.numbers_to_kafka import last, seqs
from support.bridges.routes import totals
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave
from support.ros.cameras import IMAGE, camera, from_camera, picture

from rig.peers.subscriber import DIGEST_BYTES, digest
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

COUNT = 180  # more than twice what DDS keeps for the bridge
WINDOW = 14  # of those that fit into max_in_flight_bytes, so many at least


@contextmanager
def stopped(kafka: LocalKafka) -> Iterator[None]:
    os.kill(kafka.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(kafka.pid, signal.SIGCONT)


def films_an_outage(bench: Bench, kafka: LocalKafka, topic: str, *options: str) -> Process:
    """Let a camera publish all its pictures, nearly all of them while Kafka stands still."""
    leave = Leave(bench.place)
    filming = camera(bench, *options, *leave.options, rate=40)
    leave.up_to(5)
    eventually(lambda: bench.reaches(topic, 5), 60)
    bench.close()
    with stopped(kafka):
        leave.up_to(COUNT)
        eventually(lambda: leave.out == COUNT, 60)
    return filming


def test_pictures_wait_in_ros_or_on_disk_while_kafka_stands_still_guarantees_3_4(
    own_bench: Bench, own_topic: str, own_kafka: LocalKafka, tmp_path: Path
) -> None:
    """A reliable KEEP_ALL publisher holds what does not fit, and the spool takes it at once."""
    own_bench.create_topic(spooled := f'{own_topic}.spooled')
    typed = {'source': {'type': IMAGE}}
    routes = [
        from_camera(own_topic, **typed),
        {**from_camera(spooled, **typed), 'name': 'disk', 'spool': {'path': str(tmp_path)}},
    ]
    with (
        own_bench.drained(own_bench.config(routes)) as bridge,
        films_an_outage(own_bench, own_kafka, own_topic, '--depth', '0', '--readers', '2'),
    ):
        for topic in (own_topic, spooled):
            eventually(partial(reaches_last, own_bench, topic), 60, bridge.output)
            assert seqs(own_bench.records(topic, COUNT)) == [*range(1, COUNT + 1)]
    assert 'disk: new messages go to the spool' in bridge.output()
    assert 'before the bridge' not in bridge.output()


@pytest.mark.parametrize('disk', [None, {'max_bytes': 40_000_000}], ids=['memory', 'full spool'])
def test_the_newest_pictures_are_kept_while_kafka_stands_still_guarantees_4_6(
    own_bench: Bench, own_topic: str, own_kafka: LocalKafka, tmp_path: Path, disk: Any
) -> None:
    """The publisher is KEEP_LAST, and nothing is lost before the bridge for all that."""
    spool = {'spool': {'path': str(tmp_path), **disk}} if disk else {}
    more = {'when_full': 'drop_oldest', **spool, 'source': {'type': IMAGE}}
    config = own_bench.config([from_camera(own_topic, **more)])
    with (
        own_bench.drained(config) as bridge,
        films_an_outage(own_bench, own_kafka, own_topic, '--depth', '40'),
    ):
        eventually(partial(reaches_last, own_bench, own_topic), 60, bridge.output)
    found = totals(bridge, 'camera')
    arrived = seqs(own_bench.records(own_topic, found['confirmed']))
    assert found['taken'] == COUNT
    assert found['dropped'] == COUNT - len(arrived) > 0
    assert_one_gap([seq - 1 for seq in arrived], COUNT)
    assert 'before the bridge' not in bridge.output()
    assert 'camera: drop: ' in bridge.output()


@pytest.mark.parametrize('when_full', ['wait', 'drop_oldest'])
def test_a_reader_that_stands_still_gets_all_pictures_or_the_newest_guarantees_3_4_6(
    bench: Bench, topic: str, arrived: Path, leave: Leave, when_full: str
) -> None:
    count = 100
    config = bench.config([{
        'name': 'to_ros', 'from': {'kafka': topic, 'start': 'earliest'},
        'to': {'ros': '/pictures', 'type': IMAGE}, 'format': 'cdr', 'when_full': when_full,
    }])  # fmt: skip
    pictures = [picture(number) for number in range(count)]
    numbers = {digest(cdr): number for number, cdr in enumerate(pictures)}
    options = ('--type', IMAGE, '--form', 'hash', *leave.options)
    leave.up_to(5)
    with bench.subscriber('/pictures', arrived, *options, samples=5), bench.drained(config) as run:
        bench.produce(topic, pictures[:10])
        eventually(lambda: len(digests(arrived)) == 5, 60, run.output)
        bench.produce(topic, pictures[10:])
        if when_full == 'drop_oldest':
            run.wait_for('drop: ')
        leave.up_to(count)
        eventually(lambda: digests(arrived)[-1] == digest(pictures[-1]), 60, run.output)
    found, got = totals(run), [numbers[it] for it in digests(arrived)]
    assert len(got) == found['confirmed']
    if when_full == 'wait':
        assert got == [*range(count)]
        return
    assert found['dropped'] == count - len(got) > 0
    assert_one_gap(got, count)
    assert 'before the bridge' not in run.output()


def reaches_last(bench: Bench, topic: str) -> bool:
    return last(bench, topic) == COUNT


def assert_one_gap(got: Sequence[int], count: int) -> None:
    """All but some are there, and these are older than any that waited."""
    gap = next(place for place, number in enumerate(got) if number != place)
    newest = [*range(count - len(got) + gap, count)]
    assert got == [*range(gap), *newest]
    assert len(newest) >= WINDOW


def digests(file: Path) -> list[bytes]:
    content = file.read_bytes() if file.exists() else b''
    whole = range(0, len(content) // DIGEST_BYTES * DIGEST_BYTES, DIGEST_BYTES)
    return [content[at : at + DIGEST_BYTES] for at in whole]
