"""What tests of a reload share: a bridge, its file, and its SIGHUP."""

import contextlib
import os
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from support.bridges.numbers_to_kafka import how_many
from support.bridges.numbers_to_ros import numbered
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.bridges.workers import there_and_back
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.protocol.monitor import Do, Request

DONE = 'reloaded: '
RATE = '300'
REFUSED = 'refused: all goes on as it was'


class Reloaded:
    """A bridge whose file is changed while it runs.

    Args:
        bench: Where it runs.
        process: The bridge.
        config: Its file.
        more: What its file has beside the routes, each time.
    """

    def __init__(self, bench: Bench, process: Process, config: Path, **more: Any) -> None:
        self._bench = bench
        self.config = config
        self._more = more
        self.process = process
        self.times = 0

    def write(self, routes: list[dict[str, Any]], **more: Any) -> None:
        """Change the file."""
        self._bench.config(routes, **{**self._more, **more}).replace(self.config)

    def ask(self) -> None:
        """Ask for a reload."""
        self.process.send(signal.SIGHUP)

    def to(self, routes: list[dict[str, Any]], **more: Any) -> str:
        """Change the file and reload it; returns what the bridge says that it has done."""
        self.write(routes, **more)
        self.times += 1
        self.ask()
        self.process.wait_for(DONE, 120, count=self.times)
        return self.process.output().split(DONE)[-1].split('\n')[0]


@contextmanager
def reloadable(
    bench: Bench, routes: list[dict[str, Any]], **more: Any
) -> Iterator[tuple[Reloaded, Process]]:
    """A bridge that reads already, and drains at the end."""
    config = bench.config(routes, **more)
    with bench.drained(config) as process:
        process.wait_for('reads ', 60)
        yield Reloaded(bench, process, config, **more), process


def keeps_the_routes_that_stay(bench: Bench, topic: str, **more: Any) -> None:
    """Numbers both ways, while another route changes, goes and comes back, again and again."""
    arrived, written, until = bench.place / 'arrived', f'{topic}.written', bench.place / 'until'
    other = f'{topic}.other'
    stay = [to_ros(topic, '/stays', max_rate=300), to_kafka('/numbers', written)]
    bench.create_topic(written, other)
    more = {'kafka': bench.patient_kafka, **more}
    config = bench.config(stay, **more)
    sent = 0
    with ExitStack() as stack:
        stack.enter_context(bench.subscriber('/stays', arrived))
        process = stack.enter_context(bench.bridge(config))
        process.wait_for('subscribes to', 60)
        publisher = bench.publisher('/numbers', '--until', str(until), '--rate', RATE)
        stack.enter_context(publisher)
        it = Reloaded(bench, process, config, **more)
        b = [to_ros(other, '/b', name='b', max_rate=rate) for rate in (10, 20, 30)]
        for routes, said in (
            ([*stay, b[0]], 'started b'),
            ([*stay, b[1]], 'restarted b'),
            ([*stay, b[2]], 'restarted b'),
            (stay, 'ended b'),
            (stay, 'nothing has changed'),
        ):
            bench.produce(topic, numbered(sent + 1000)[sent:])
            sent += 1000
            goal = bench.end_offset(written) + 100
            eventually(partial(bench.reaches, written, goal), 90, process.output)
            assert it.to(routes) == said
        until.touch()
        publisher.wait_for('published ', 60)
        count = how_many(publisher)
        eventually(lambda: str(sent - 1) in lines(arrived)[-1:], 120, process.output)
        records = bench.records(written, count, timeout_s=120)
        assert process.end(40) == 0, process.output()
    assert values(records) == numbered(count), 'nothing is lost, repeated or out of order'
    assert [int(line) for line in lines(arrived)] == list(range(sent))
    assert process.output().count('to_ros: reads') == 1
    assert process.output().count('subscribes to') == 1


def refuses_a_bad_file(bench: Bench, topic: str, returned: str, **more: Any) -> None:
    """With every mistake, and goes on."""
    routes = there_and_back(topic)
    with reloadable(bench, routes, **more) as (it, process):
        process.wait_for('subscribes to', 60)
        bad = [to_ros(topic, 'no slash'), to_kafka('/orders', returned, format='xml')]
        it.write(bad)
        it.ask()
        process.wait_for(REFUSED, 60)
        assert 'routes[0].to.ros: ' in process.output()
        assert 'routes[1].format: ' in process.output()
        it.config.write_text('a: [')
        it.ask()
        process.wait_for(REFUSED, 60, count=2)
        it.config.unlink()
        it.ask()
        process.wait_for(REFUSED, 60, count=3)
        assert 'no such file' in process.output()
        bench.produce(topic, numbered(10))
        eventually(partial(bench.reaches, returned, 10), 60, process.output)
        assert it.to(routes) == 'nothing has changed'
    assert 'Traceback' not in process.output()
    assert process.output().count('subscribes to') == 1


def request(process: Process, do: Do, route: str = '') -> None:
    """Ask a supervisor for something, through the pipe of the process that watches the bridge."""
    line = msgspec.json.encode(Request(1_000_000, do, route)) + b'\n'
    eventually(lambda: _write(process, line), 60, process.output)


def _write(process: Process, line: bytes) -> bool:
    monitor = int(re.findall(r'the monitor is process (\d+)', process.output())[-1])
    shared = _pipes(process.pid)
    for number, pipe in _pipes(monitor).items():
        if number > 2 and pipe in shared.values() and _writes(monitor, number):
            with Path(f'/proc/{monitor}/fd/{number}').open('wb', buffering=0) as end:
                end.write(line)
            return True
    return False


def _pipes(pid: int) -> dict[int, str]:
    place = Path(f'/proc/{pid}/fd')
    found = {}
    for entry in place.iterdir():
        with contextlib.suppress(OSError):
            found[int(entry.name)] = str(entry.readlink())
    return {number: target for number, target in found.items() if target.startswith('pipe:')}


def _writes(pid: int, descriptor: int) -> bool:
    flags = Path(f'/proc/{pid}/fdinfo/{descriptor}').read_text().split('flags:')[1].split()[0]
    return int(flags, 8) & os.O_ACCMODE == os.O_WRONLY
