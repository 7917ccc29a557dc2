"""What can happen to the supervisor of a bridge: its workers, its file, what it is asked for.

Time passes only while it waits, in steps.
"""

import os
import selectors
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import pytest
from hypothesis import strategies as st
from support.worlds.supervised_processes import NEVER, Check, File, Judge, Life, Process, Worker

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.process.config_diff import Checked, difference
from ros2_kafka_bridge.process.plan import MonitoringPlan, Plan, RoutePlan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.supervisor import Supervisor
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.protocol.monitor import Answer, Do, Lifecycle, Request

TICK_S: Final = 0.25
QUIET_S: Final = 10.0
"""Behind the last event, before a world that has come to rest is stopped."""
SETTLED_S: Final = 4000.0
"""Longer than all that may go wrong in a world takes together."""

ROUTES: Final = 'abcd'
_CHECK: Final = 'process.config_diff'


class Bridge:
    """What is tested: all that depends on the names of its parts."""

    def __init__(self, plan: Plan) -> None:
        self._it = Supervisor(plan, ['--', plan.file], Systemd(), Signals())

    def run(self) -> int:
        with self._it as it:
            return it.run()

    def request(self, request: Request, answer: Callable[[Answer], None]) -> None:
        self._it.control.handle(request, answer)

    def stop(self) -> None:
        self._it.stop.ask()

    @property
    def is_stopping(self) -> bool:
        return self._it.stop.asked

    @property
    def is_busy(self) -> bool:
        return self._it.control.is_busy

    @property
    def lifecycle(self) -> Lifecycle:
        return self._it.control.lifecycle

    @property
    def plan(self) -> Plan:
        return self._it.pool.plan

    @property
    def owned(self) -> list[str]:
        """The routes of each worker, started or not."""
        return [name for worker in self._it.pool.workers for name in worker.snapshots]


class Event(NamedTuple):
    """Something that happens.

    Args:
        what: It is; a request by the name of what is to be done.
        which: Route, worker or file.
        how: The status of one that crashes.
        after_s: The event before it.
    """

    what: str
    which: int = 0
    how: int = 1
    after_s: float = 1.0


class World:
    """What is there, and its time.

    Args:
        files: What the file of the bridge may hold; the first is what it begins with.
        lives: Of its workers, as they are started; any further ones live well.
        events: What happens.
    """

    bridge: Bridge
    judge: Judge

    def __init__(
        self, files: Sequence[File], lives: Sequence[Life], events: Sequence[Event]
    ) -> None:
        self.now_s = 1000.0
        self.processes: list[Process] = []
        self.files, self.file = files, files[0]
        self.checked = Checked()  # what a check has found last
        self._lives, self._events = [*lives], [*events]
        self._at_s = self.now_s
        self._requests = 0
        self._no_room = 0

    @property
    def workers(self) -> list[Worker]:
        """Those that live, in the order of their start."""
        return [it for it in self.processes if isinstance(it, Worker) and it.lives]

    def popen(
        self, args: Sequence[str], *, pass_fds: Sequence[int] = (), **_others: Any
    ) -> Process:
        """Start a process, as `subprocess.Popen`."""
        module = args[args.index('-m') + 1]
        pid = 1000 + len(self.processes)
        made: Process
        if self._no_room:
            self._no_room -= 1
            names = [name for word in args for name in word.removeprefix('--routes=').split(',')]
            self.judge.not_started([name for name in names if name in ROUTES])
            raise BlockingIOError(11, 'Resource temporarily unavailable')
        if module.endswith(_CHECK):
            self.checked = Checked()
            made = Check(self, pid, args, pass_fds)
        else:
            life = self._lives.pop(0) if self._lives else Life()
            made = Worker(self, pid, args, pass_fds, life)
        self.processes.append(made)
        if isinstance(made, Worker):
            self.judge.started(made)
        return made

    def check(self, before: Plan, file: File) -> bytes:
        """What a check of a file tells."""
        found = Checked(problems=('a mistake',))
        if file.plan is not None:
            found = Checked(file.plan, difference(before, file.plan))
        data = msgspec.json.encode(found) + b'\n'
        if file.is_cut:
            return data[: len(data) // 2]
        self.checked = found
        return data

    def turn(self) -> None:
        """Let time pass."""
        self.now_s += TICK_S
        while self._events and self.now_s >= self._at_s + self._events[0].after_s:
            self._at_s += self._events[0].after_s
            self._happen(self._events.pop(0))
        for process in self.processes:
            if process.lives:
                process.step()
        self.judge.turned()
        is_quiet = not self._events and self.now_s >= self._at_s + QUIET_S
        if is_quiet and not self.bridge.is_stopping:
            assert self.now_s < self._at_s + SETTLED_S, 'it does not come to rest'
            if self.judge.is_settled():
                self.bridge.stop()

    def _happen(self, event: Event) -> None:
        match event.what:
            case 'crash':
                if self.workers:
                    self.workers[event.which % len(self.workers)].end(event.how)
            case 'no room':
                self._no_room += event.which
            case 'stop':
                if self.bridge.is_stopping:
                    self.judge.at_once_s = min(self.judge.at_once_s, self.now_s)
                self.bridge.stop()
            case 'flood':
                for do, route in product((Do.PAUSE, Do.RESUME) * 80, ROUTES):
                    self._ask(do, route)
            case _:
                if event.what in (Do.RELOAD, Do.PREVIEW, Do.CONFIGURE):
                    self.file = self.files[event.which % len(self.files)]
                self._ask(Do(event.what), ROUTES[event.which % len(ROUTES)])

    def _ask(self, do: Do, route: str) -> None:
        self._requests += 1
        request = Request(self._requests, do, route)
        self.judge.asked(request)
        self.bridge.request(request, lambda answer: self.judge.answered(request, answer))

    def close(self) -> None:
        """End what is left where something has failed."""
        for process in self.processes:
            if process.lives:
                process.status = -9
                for descriptor in process.open:
                    os.close(descriptor)
            process.stdin.close()


@contextmanager
def a_world(
    files: Sequence[File], lives: Sequence[Life], events: Sequence[Event]
) -> Iterator[World]:
    """Make a world in which no process is started, and time passes only as it says."""
    world, first = World(files, lives, events), files[0].plan
    assert first is not None
    select, write = selectors.DefaultSelector.select, os.write

    def note(descriptor: int, data: bytes) -> int:
        written = write(descriptor, data)
        for worker in world.workers:
            worker.note(descriptor, data, written)
        return written

    def wait(
        selector: selectors.DefaultSelector, _timeout: float | None = None
    ) -> list[tuple[selectors.SelectorKey, int]]:
        # What is told just before an end is read before that end is seen, or behind it.
        if round(world.now_s / TICK_S) % 2:
            world.turn()
            return select(selector, 0)
        found = select(selector, 0)
        world.turn()
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('subprocess.Popen', world.popen)
        patch.setattr('os.write', note)
        patch.setattr('time.monotonic', lambda: world.now_s)
        patch.setattr('selectors.DefaultSelector.select', wait)
        try:
            world.bridge = Bridge(first)
            yield world
        finally:
            world.close()


def settings_of(plan: Plan, name: str) -> Any:
    return next(route for route in plan.values['routes'] if route['name'] == name)


def open_files() -> Counter[str]:
    """What is open, but for wakeups: these are closed with the last reference to them."""
    found: list[str] = []
    for file in Path('/proc/self/fd').iterdir():
        with suppress(FileNotFoundError):  # that of the folder itself
            found.append(str(file.readlink()))
    return Counter(name for name in found if 'eventfd' not in name)


# Any of them

Spec = tuple[Direction, float, int]
SPECS = st.tuples(st.sampled_from(Direction), st.sampled_from((0.5, 3.0, 20.0)), st.just(1))
NAMES = st.sampled_from(ROUTES)


def plan_of(specs: dict[str, Spec], workers: int, *, starts: bool) -> Plan:
    routes = tuple(RoutePlan(name, spec[0], spec[1]) for name, spec in specs.items())
    values = {
        'routes': [{'name': name, 'settings': [*spec]} for name, spec in specs.items()],
        'workers': workers,
    }
    start = MonitoringPlan('off', 'active' if starts else 'unconfigured')
    return Plan('x', values, routes, workers=workers, monitoring=start)


@st.composite
def all_files(draw: st.DrawFn, *, starts: bool = True, changes: bool = True) -> list[File]:
    """What the file holds first, and later on."""
    first = draw(st.dictionaries(NAMES, SPECS, min_size=1, max_size=4))
    workers = draw(st.integers(1, 3))
    files = [File(plan_of(first, workers, starts=starts))]
    for _ in range(draw(st.integers(1, 3)) if changes else 0):
        edits = draw(st.dictionaries(NAMES, st.none() | SPECS, min_size=1, max_size=3))
        specs = {n: spec for n, spec in {**first, **edits}.items() if spec is not None}
        plan = plan_of(specs, workers, starts=starts) if specs else None
        takes_s = draw(st.sampled_from((0.0, 0.0, 5.0, 70.0)))
        files.append(File(plan, takes_s, draw(st.integers(0, 9)) == 9))
    return files


def files_of(*routes: str) -> list[File]:
    """What a file holds at one time after the other: routes to ROS."""
    one = Direction.KAFKA_TO_ROS, 0.5, 1
    return [File(plan_of(dict.fromkeys(it, one), 1, starts=True), 0.0) for it in routes]


def _life(**fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Life]:
    """One that lives well but for these (`builds` would draw anything for the others, too)."""
    return st.fixed_dictionaries(fields).map(lambda it: Life(**it))


STATUSES = st.sampled_from((-9, -11, 1, 0, 2))
TIMES = (0.5, 1.0, 12.0, 20.0)
CUTS = st.sampled_from((100_000, 997, 333))
SLOW = _life(
    loads_s=st.sampled_from((0.0, *TIMES, 130.0, NEVER)),
    begins_s=st.sampled_from((0.0, *TIMES)),
    ends_s=st.sampled_from((0.0, *TIMES, 30.0, NEVER)),
    exits_s=st.sampled_from((0.0, 0.0, 1.0, NEVER)),
    silent=st.booleans(),
)
ENDING = _life(ends_s=st.sampled_from((*TIMES, NEVER)))
DYING = _life(
    loads_s=st.sampled_from((0.0, 0.5)),
    ends_s=st.sampled_from((0.0, *TIMES)),
    dies_s=st.sampled_from((0.0, 0.75, 4.0, 10.0, 33.0)),
    status=STATUSES,
)
FAILING = _life(
    fails_s=st.sampled_from((0.0, 1.0, 6.0)),
    fails=st.sampled_from((1, 1, 4)),
    dies_s=st.sampled_from((NEVER, NEVER, 2.0, 8.0)),
    status=STATUSES,
    cut=CUTS,
)
DEAF = _life(
    deaf_s=st.sampled_from((3.0, 20.0, 50.0)), ends_s=st.sampled_from((0.0, 1.0)), cut=CUTS
)
LIVES = st.lists(st.just(Life()) | ENDING | SLOW | DYING | FAILING | DEAF, max_size=8)

LATER = st.tuples(st.integers(0, 3), LIVES).map(lambda it: [Life()] * it[0] + it[1])
"""The first of them live well, as what a reload begins with."""


def any_of(*what: str, least: int = 0) -> st.SearchStrategy[list[Event]]:
    """Some that happen one after the other."""
    one = st.builds(
        Event,
        st.sampled_from(what),
        st.integers(0, 3),
        STATUSES,
        st.sampled_from((0.25, 1.0, 3.0, 10.0, 40.0)),
    )
    return st.lists(one, min_size=least, max_size=12)
