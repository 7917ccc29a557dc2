"""What tests of workers share: which processes they are, what they tell, whether they are gone."""

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import count as counted
from pathlib import Path
from typing import Any, Self

from support.bridges.routes import to_kafka, to_ros
from support.kafka.paced import Stream
from support.patience import patient
from support.processes.harness import PATIENCE_S, Bench, Process, eventually

from rig.processes import KILLED_S


def there_and_back(kafka: str, **more: Any) -> list[dict[str, Any]]:
    """Two routes, Kafka -> ROS -> Kafka, into a topic `.returned`."""
    return [to_ros(kafka, '/orders', **more), to_kafka('/orders', f'{kafka}.returned')]


def good_and_bad(bench: Bench, topic: str) -> tuple[str, str, list[dict[str, Any]]]:
    """Two topics, and their routes to ROS, the bad one of which stops at what is no text."""
    bad, good = f'{topic}.bad', f'{topic}.good'
    bench.create_topic(bad, good)
    stopping = to_ros(bad, '/bad', name='bad', on_error='stop', min_subscribers=0)
    return bad, good, [stopping, to_ros(good, '/good', name='good', min_subscribers=0)]


def bridge(bench: Bench, config: Path) -> Process:
    """Start a bridge with workers, and wait until both routes run."""
    with ExitStack() as stack:
        process = stack.enter_context(bench.bridge(config))
        process.wait_for('subscribes to', 60)
        process.wait_for('reads ', 60)
        stack.pop_all()
    return process


def pids(process: Process, worker: int) -> list[int]:
    """The processes that a worker has been so far, the last one being the one that runs."""
    found = re.findall(rf'worker {worker} \(.*\) is process (\d+)', process.output())
    return [int(pid) for pid in found]


def last_of(process: Process, worker: int) -> int:
    """The process that a worker is now."""
    return pids(process, worker)[-1]


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has waited for yet has ended, too."""
    try:
        return ' (zombie)' in Path(f'/proc/{pid}/status').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return True


def wait_until_gone(*all_of: int) -> None:
    """Wait until none of these processes runs."""
    eventually(lambda: all(map(gone, all_of)), 60, lambda: f'one of {all_of} still runs')


def sized(count: int) -> list[bytes]:
    """So many records, each with its number."""
    return list(_sized(range(count)))


def stream(bench: Bench, topic: str) -> Stream:
    """Such records without an end: what is stopped before that is stopped in mid-stream."""
    return Stream(bench, topic, _sized(counted()), rate=2000.0)


def _sized(numbers: Iterable[int]) -> Iterator[bytes]:
    return (f'{number}'.encode().ljust(500) for number in numbers)


class Watched:
    """A worker of its own, and the end of its pipe."""

    def __init__(self, bench: Bench, config: Path) -> None:
        self.pipe, its_end = os.pipe()
        with (bench.place / 'worker.log').open('ab') as log:
            self.process = subprocess.Popen(
                [
                    *(sys.executable, '-m', 'ros2_kafka_bridge.process.start', str(config)),
                    f'--snapshots={its_end}',
                ],
                pass_fds=(its_end,),
                stderr=log,
            )
        os.close(its_end)
        self.log = bench.place / 'worker.log'
        self._closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(patient(KILLED_S))
        self.stop_reading()

    def stop_reading(self) -> None:
        """Close this end of the pipe."""
        if not self._closed:
            os.close(self.pipe)
        self._closed = True

    def lines(self) -> Iterator[bytes]:
        """What is sent, line by line, until the worker closes the pipe."""
        rest = b''
        while True:
            assert select.select([self.pipe], [], [], patient(PATIENCE_S))[0], self.log.read_text()
            data = os.read(self.pipe, 65536)
            if not data:
                break
            *whole, rest = (rest + data).split(b'\n')
            yield from whole
        assert rest == b''

    def end(self) -> int:
        self.process.terminate()
        return self.process.wait(patient(40))


def kill(process: Process, worker: int) -> int:
    """SIGKILL a worker, and wait until it runs again; returns what the other was before."""
    before = pids(process, worker)
    other = pids(process, 3 - worker)[-1]
    os.kill(before[-1], signal.SIGKILL)
    process.wait_for(f'worker {worker} (', 60, count=2)
    eventually(lambda: len(pids(process, worker)) > len(before), 60, process.output)
    return other
