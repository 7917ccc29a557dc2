"""A reload, step by step: check the file, load what is new, drain what is old, begin."""

import contextlib
import os
import subprocess
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Final

import msgspec

from ros2_kafka_bridge.exclusive.handover_window import KNOWN_S
from ros2_kafka_bridge.process.child import start_child
from ros2_kafka_bridge.process.crew import CLOSING_S, Crew
from ros2_kafka_bridge.process.difference import Checked, Difference
from ros2_kafka_bridge.process.plan import Plan, Share, held_plan, share_out
from ros2_kafka_bridge.process.worker_process import WorkerProcess

_CHECK_S: Final = 60.0
_LOAD_S: Final = 120.0
_CHUNK_BYTES: Final = 1024 * 1024
_AS_BEFORE: Final = 'nothing was changed'

_CHECKED: Final = msgspec.json.Decoder(Checked)


# Check


def check(plan: Plan) -> Generator[None, None, Checked]:
    """Read the file of a plan again, in a process of its own."""
    try:
        with _checker(plan) as process:
            data = yield from _all_of(process)
        return _late(plan) if data is None else _CHECKED.decode(data)
    except (OSError, ValueError):
        return Checked(problems=('the file could not be checked: the log says why',))


@contextmanager
def _checker(plan: Plan) -> Iterator[subprocess.Popen[bytes]]:
    with held_plan(plan) as descriptor:
        process = start_child(
            'process.difference',
            [f'--plan={descriptor}'],
            [descriptor],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _late(plan: Plan) -> Checked:
    cure = 'is it a file, and does its disk answer?'
    problem = f'{plan.file}: reading it has taken longer than {_CHECK_S:.0f} s: {cure}'
    return Checked(problems=(problem,))


def _all_of(process: subprocess.Popen[bytes]) -> Generator[None, None, bytes | None]:
    """What a process prints until it ends; None where that takes too long."""
    assert process.stdout is not None, 'it was started with a pipe'
    pipe, data = process.stdout.fileno(), b''
    os.set_blocking(pipe, False)
    deadline_s = time.monotonic() + _CHECK_S
    while time.monotonic() < deadline_s:
        with contextlib.suppress(BlockingIOError):
            while chunk := os.read(pipe, _CHUNK_BYTES):
                data += chunk
            return data
        yield
    return None


# Hand over


def hand_over(
    crew: Crew, before: Plan, after: Plan, found: Difference, descriptor: int
) -> Generator[None, None, str]:
    """Let new workers run what is new and what has changed; returns what has prevented it.

    They load everything while the old ones still run, and are known to the publishers that they
    are to read by then. The old have closed a route before the new begin it: two of them would
    fight for its spool, and for its turn.

    Args:
        crew: The workers.
        before: What counted so far.
        after: What is to count.
        found: What differs.
        descriptor: Of a file in memory that holds the latter.
    """
    fresh = crew.hire(_shares(crew, before, after, found), descriptor, waits=True)
    problem = yield from _load(fresh)
    known_s = time.monotonic() + KNOWN_S
    if problem:
        yield from _dismiss(fresh)
        return problem
    to_ros, from_ros = before.directions({*found.removed, *found.changed})
    if set(from_ros) & set(found.changed):
        yield from _wait_until(known_s)
    for names in (to_ros, from_ros):
        late = yield from crew.end(names, before.drain_s)
        if late:
            yield from _dismiss(fresh)
            return _held(late)
    for worker in fresh:
        worker.begin()
    return ''


def _shares(crew: Crew, before: Plan, after: Plan, found: Difference) -> list[Share]:
    """The new and changed routes, in as many workers as the others leave.

    There is one for each direction at least.
    """
    to_ros, from_ros = after.directions({*found.added, *found.changed})
    stay = [w for w in crew.workers if w.snapshots.keys() & set(found.unchanged)]
    least = bool(to_ros) + bool(from_ros)
    return share_out(to_ros, from_ros, max(least, before.workers - len(stay)))


def _load(fresh: list[WorkerProcess]) -> Generator[None, None, str]:
    deadline_s = time.monotonic() + _LOAD_S
    while not all(worker.loaded for worker in fresh):
        if any(worker.refused for worker in fresh):
            return f'the new routes cannot start: the log says why: {_AS_BEFORE}'
        if time.monotonic() > deadline_s:
            return f'the new routes did not load in {_LOAD_S:.0f} s: {_AS_BEFORE}'
        yield
    return ''


def _wait_until(time_s: float) -> Generator[None, None, None]:
    while time.monotonic() < time_s:
        yield


def _held(late: list[str]) -> str:
    return (
        f'{", ".join(late)} did not end in time, in the first process, which cannot be killed '
        f'alone: {_AS_BEFORE}: what has ended begins again as it was, and the rest when it ends: '
        'restart the bridge where it does not'
    )


def _dismiss(fresh: list[WorkerProcess]) -> Generator[None, None, None]:
    deadline_s = time.monotonic() + CLOSING_S
    for worker in fresh:
        worker.ask(1)
    while any(worker.runs for worker in fresh) and time.monotonic() < deadline_s:
        yield
    for worker in fresh:
        if worker.runs:
            worker.kill()
        worker.over = True
        worker.forget(list(worker.snapshots))


# In words


def would(found: Difference) -> str:
    """What a reload would do."""
    return _words(found, 'restarts', 'starts', 'ends')


def did(found: Difference) -> str:
    """What a reload has done."""
    return _words(found, 'restarted', 'started', 'ended')


def _words(found: Difference, again: str, new: str, old: str) -> str:
    if found.is_empty:
        return 'nothing has changed'
    parts = [
        f'{verb} {", ".join(names)}'
        for verb, names in ((again, found.changed), (new, found.added), (old, found.removed))
        if names
    ]
    parts += ['no route is touched'] * (not parts)
    if found.at_next_start:
        parts.append('some of it counts only when the bridge is started again')
    return '; '.join(parts)
