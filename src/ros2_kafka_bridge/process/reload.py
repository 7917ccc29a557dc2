"""A reload, step by step: check the file, load what is new, drain what is old, begin."""

import selectors
import time
from collections.abc import Generator
from typing import Final

import msgspec

from ros2_kafka_bridge.exclusive.handover_window import KNOWN_S
from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.config_diff import Checked, Difference
from ros2_kafka_bridge.process.draining import end_routes, end_workers
from ros2_kafka_bridge.process.plan import Plan, Share, held_plan, share_out
from ros2_kafka_bridge.process.worker_handle import WorkerHandle
from ros2_kafka_bridge.process.worker_pool import WorkerPool

_CHECK_S: Final = 60.0
_LOAD_S: Final = 120.0
_AS_BEFORE: Final = 'nothing was changed'

_CHECKED: Final = msgspec.json.Decoder(Checked)

# Check


def check(plan: Plan, selector: selectors.BaseSelector) -> Generator[None, None, Checked]:
    """Read the file of a plan again, in a process of its own.

    Args:
        plan: Of that file.
        selector: Where the process is waited for.

    Raises:
        OSError: There is no room for a process.
    """
    process = ChildProcess('process.config_diff', 'result', selector)
    try:
        return (yield from _result_of(process, plan))
    except ValueError:
        return Checked(problems=('the file could not be checked: the log says why',))
    finally:
        process.kill()
        process.close()


def _result_of(process: ChildProcess, plan: Plan) -> Generator[None, None, Checked]:
    with held_plan(plan) as descriptor:
        process.start([f'--plan={descriptor}'], [descriptor])
    deadline_s = time.monotonic() + _CHECK_S
    while time.monotonic() < deadline_s:
        has_ended = process.exit_status() is not None
        for line in process.exchange():
            return _CHECKED.decode(line)
        if has_ended:
            raise ValueError('it has told nothing')
        yield
    cure = 'is it a file, and does its disk answer?'
    problem = f'{plan.file}: reading it has taken longer than {_CHECK_S:.0f} s: {cure}'
    return Checked(problems=(problem,))


# Hand over


def hand_over(pool: WorkerPool, after: Plan, found: Difference) -> Generator[None, None, str]:
    """Let new workers run what is new and what has changed; returns what has prevented it.

    They load everything while the old ones still run, and are known to the publishers that they
    are to read by then. The old have closed a route before the new begin it: two of them would
    fight for its spool, and for its turn.

    Args:
        pool: The workers, with the plan that counted so far.
        after: What is to count.
        found: What differs.
    """
    before = pool.plan
    fresh = pool.add(_shares(pool, after, found), after)
    problem = yield from _load(fresh)
    known_s = time.monotonic() + KNOWN_S
    if problem:
        yield from end_workers(fresh)
        return problem
    to_ros, from_ros = before.directions({*found.removed, *found.changed})
    if set(from_ros) & set(found.changed):
        yield from _wait_until(known_s)
    for names in (to_ros, from_ros):
        late = yield from end_routes(pool.workers, names, before.drain_s)
        if late:
            yield from end_workers(fresh)
            return _held(late)
    if problem := _problem_of(fresh):
        yield from end_workers(fresh)
        return problem
    for worker in fresh:
        worker.begin()
    return ''


def _shares(pool: WorkerPool, after: Plan, found: Difference) -> list[Share]:
    """The new and changed routes, in as many workers as the others leave.

    There is one for each direction at least.
    """
    to_ros, from_ros = after.directions({*found.added, *found.changed})
    stay = [w for w in pool.workers if w.snapshots.keys() & set(found.unchanged)]
    least = bool(to_ros) + bool(from_ros)
    return share_out(to_ros, from_ros, max(least, pool.plan.workers - len(stay)))


def _load(fresh: list[WorkerHandle]) -> Generator[None, None, str]:
    deadline_s = time.monotonic() + _LOAD_S
    while not all(worker.has_loaded for worker in fresh):
        if problem := _problem_of(fresh):
            return problem
        if time.monotonic() > deadline_s:
            return f'the new routes did not load in {_LOAD_S:.0f} s: {_AS_BEFORE}'
        yield
    return ''


def _problem_of(fresh: list[WorkerHandle]) -> str:
    if any(worker.is_over for worker in fresh):
        return f'the new routes cannot start: the log says why: {_AS_BEFORE}'
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
