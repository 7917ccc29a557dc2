"""The processes of a bridge, as its supervisor sees them, though none is started.

Each speaks the protocol of the real one through real pipes, and lives as a test says: its time is
that of a world (`supervised_worlds.py`).
"""

import fcntl
import io
import math
import os
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.process.plan import Plan, RoutePlan, read_plan
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.monitor import Answer, Request
from ros2_kafka_bridge.protocol.worker import Begin, Drain, End, PauseRoute, ResumeRoute
from ros2_kafka_bridge.route import counters
from ros2_kafka_bridge.route.counters import Counters, State

NEVER: Final = math.inf
_PERIOD_S: Final = 1.0
_PIPE_BYTES: Final = 4096


class Life(NamedTuple):
    """How a worker lives: well, unless it says otherwise.

    Args:
        loads_s: How long that takes.
        begins_s: How long its routes take to begin.
        ends_s: How long a route takes to end, and all of them to drain.
        exits_s: How long it is there for behind that.
        dies_s: When it dies.
        status: How.
        fails_s: Behind its begin, when routes of it fail for good.
        fails: How many.
        deaf_s: For how long it reads no orders.
        cut: How many bytes it writes at a time.
        silent: Whether it says nothing until it has loaded.
    """

    loads_s: float = 0.0
    begins_s: float = 0.0
    ends_s: float = 0.0
    exits_s: float = 0.0
    dies_s: float = NEVER
    status: int = 1
    fails_s: float = NEVER
    fails: int = 1
    deaf_s: float = 0.0
    cut: int = 100_000
    silent: bool = False


class File(NamedTuple):
    """What a check finds in the file of the bridge.

    Args:
        plan: None is a mistake.
        takes_s: How long the check takes.
        is_cut: Whether it dies while it tells.
    """

    plan: Plan | None
    takes_s: float = 0.5
    is_cut: bool = False

    @property
    def routes(self) -> tuple[RoutePlan, ...]:
        return () if self.plan is None else self.plan.routes


class Judge(Protocol):
    """Told of what happens."""

    at_once_s: float

    def started(self, worker: 'Worker') -> None: ...
    def not_started(self, routes: Sequence[str]) -> None: ...
    def told(self, worker: 'Worker', order: wire.WorkerOrder) -> None: ...
    def killed(self, worker: 'Worker') -> None: ...
    def ended(self, worker: 'Worker') -> None: ...
    def asked(self, request: Request) -> None: ...
    def answered(self, request: Request, answer: Answer) -> None: ...
    def turned(self) -> None: ...
    def is_settled(self) -> bool: ...


class Surroundings(Protocol):
    """What processes see of their world."""

    now_s: float
    judge: Judge
    file: File

    def check(self, before: Plan, file: File) -> bytes: ...


class Process:
    """As `subprocess.Popen` gives it out."""

    def __init__(
        self, world: Surroundings, pid: int, args: Sequence[str], kept: Sequence[int]
    ) -> None:
        self.world = world
        self.pid = pid
        self.options = dict(word.split('=', 1) for word in args if '=' in word)
        there = {int(file.name) for file in Path('/proc/self/fd').iterdir()}
        assert {*kept} <= there, 'a closed file is handed on'
        self.plan = read_plan(int(self.options['--plan']))
        self.started_s = world.now_s
        self.returncode: int | None = None
        self.status: int | None = None
        self.is_killed = False
        self.ended_s = NEVER
        self.orders, its_end = os.pipe()
        self.stdin = io.FileIO(its_end, 'w')
        self.open = [self.orders]  # its ends of pipes

    def step(self) -> None:
        """Live for a while."""
        raise NotImplementedError

    @property
    def lives(self) -> bool:
        return self.status is None

    def poll(self) -> int | None:
        self.returncode = self.status
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.lives and not self.is_killed:
            assert timeout is not None, f'{self.options}: waited for without an end'
            raise subprocess.TimeoutExpired(self.options.popitem(), timeout)
        if self.lives:
            self.end(-9)
        self.returncode = self.status
        assert self.returncode is not None
        return self.returncode

    def kill(self) -> None:
        if self.lives and not self.is_killed and isinstance(self, Worker):
            self.world.judge.killed(self)
        self.is_killed = True

    terminate = kill

    def end(self, status: int) -> None:
        """Have the process end."""
        if isinstance(self, Worker):
            self.has_at_end = self.has
        self.status, self.ended_s = status, self.world.now_s
        while self.open:
            os.close(self.open.pop())
        if isinstance(self, Worker):
            self.world.judge.ended(self)


class Check(Process):
    """Tells what is in the file."""

    def __init__(
        self, world: Surroundings, pid: int, args: Sequence[str], kept: Sequence[int]
    ) -> None:
        super().__init__(world, pid, args, kept)
        self._pipe = os.dup(int(self.options['--result']))
        self.open.append(self._pipe)
        self._file = world.file

    def step(self) -> None:
        file = self._file
        if self.is_killed:
            self.end(-9)
        elif self.world.now_s >= self.started_s + file.takes_s:
            os.write(self._pipe, self.world.check(self.plan, file))
            self.end(0)


class Worker(Process):
    """Runs routes."""

    def __init__(
        self, world: Surroundings, pid: int, args: Sequence[str], kept: Sequence[int], life: Life
    ) -> None:
        super().__init__(world, pid, args, kept)
        self.life = life
        self.number = int(self.options['--worker'])
        # As the real one: no names are all.
        self.routes = [n for n in self.options['--routes'].split(',') if n] or self.plan.names
        self.paused = {n for n in self.options.get('--paused', '').split(',') if n}
        self.began_paused = frozenset(self.paused)
        self.may_begin = '--waits' not in args
        self.has_at_end: set[str] = set()  # of routes
        self.given = self._read = b''
        self.drain_s: list[float] = []  # when it was told to
        self.end_s: dict[str, float] = {}
        self.begin_s = self.heard_s = self.started_s
        self.final: set[str] = set()  # that have failed, as it has told
        self.has_begun = False  # and has told it
        self.was_full = False  # the pipe of its orders
        self._noted = 0
        self._is_asked = self.may_begin  # as it knows
        self._ends_at_s: dict[str, float] = dict.fromkeys(self.routes, NEVER)
        self._drained_at_s = self._exits_at_s = NEVER
        self._begun_s = NEVER
        self._failing: list[str] = []
        self._unsaid: list[tuple[bytes, wire.Event | list[str]]] = []
        self._is_loaded = self._says_begun = False
        fcntl.fcntl(self.orders, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self.orders, False)
        its_own = int(self.options['--snapshots'])
        assert its_own in kept, 'it could not tell anything'
        self._pipe = os.dup(its_own)
        os.set_blocking(self._pipe, False)
        self.open += [self._pipe, *map(os.dup, {*kept} - {its_own})]

    @property
    def runs(self) -> set[str]:
        """The routes that it runs now."""
        if not self.lives or self._begun_s == NEVER or self._drained_at_s <= self.world.now_s:
            return set()
        return self._ends_at_s.keys() - self._failing

    @property
    def has(self) -> set[str]:
        """The routes that it runs, or will, for all that it has told."""
        return self._ends_at_s.keys() - self.final if self.lives else set()

    @property
    def direction(self) -> Direction | None:
        """That of its routes; None: they go both ways."""
        found = {route.direction for route in self.plan.routes if route.name in self.routes}
        return found.pop() if len(found) == 1 else None

    @property
    def is_up_to_date(self) -> bool:
        """Whether it has heard and told everything."""
        return self.has_begun and not self._unsaid and len(self._read) == len(self.given)

    def note(self, descriptor: int, data: bytes, written: int) -> None:
        """Note what was written, if it is an order for this worker, however late it is read."""
        if self.stdin.closed or descriptor != self.stdin.fileno():
            return
        self.given += data[:written]
        self.was_full = self.was_full or written < len(data)
        now_s = self.world.now_s
        *lines, _ = self.given[self._noted :].split(b'\n')
        self._noted += sum(len(line) + 1 for line in lines)
        for order in map(wire.ORDERS.decode, lines):
            self.world.judge.told(self, order)
            match order:
                case Drain():
                    self.drain_s.append(now_s)
                case Begin():
                    self.may_begin, self.begin_s = True, now_s
                case End(routes):
                    self.end_s |= dict.fromkeys(routes, now_s)
                case _:
                    pass

    # Its life

    def step(self) -> None:
        now_s, life = self.world.now_s, self.life
        if self.is_killed:
            self.end(-9)
        elif now_s >= self.started_s + life.dies_s:
            self.end(life.status)
        else:
            if now_s >= self.started_s + life.deaf_s:
                self._hear()
            self._live(now_s)
            self._write()
            if now_s >= self._exits_at_s and not self._unsaid:
                self.end(1 if self._failing else 0)

    def _hear(self) -> None:
        try:
            data = os.read(self.orders, 2 * _PIPE_BYTES)
        except BlockingIOError:
            return
        assert data, f'{self.options}: its supervisor has gone'
        before, self._read = len(self._read), self._read + data
        begun = self._read.rfind(b'\n', 0, before) + 1
        *lines, _ = self._read[begun:].split(b'\n')
        for order in map(wire.ORDERS.decode, lines):
            self._obey(order)

    def _obey(self, order: wire.WorkerOrder) -> None:
        at_s = self.world.now_s + self.life.ends_s
        match order:
            case Drain():
                again_s = self.world.now_s + 1 if len(self.drain_s) > 1 else NEVER
                self._drained_at_s = min(self._drained_at_s, at_s, again_s)
            case End(routes):
                self._ends_at_s |= dict.fromkeys(routes & self._ends_at_s.keys(), at_s)
            case PauseRoute(route):
                self.paused.add(route)
            case ResumeRoute(route):
                self.paused.discard(route)
            case Begin():
                self._is_asked = True

    def _live(self, now_s: float) -> None:
        if not self._is_loaded and now_s >= self.started_s + self.life.loads_s:
            self._is_loaded = True
            self._say(wire.Loaded())
        if self._is_loaded and self._begun_s == NEVER and self._is_asked:
            self._begun_s = now_s
        if self._begun_s == NEVER:
            if self._is_loaded and self._drained_at_s < NEVER:
                self._exits_at_s = min(self._exits_at_s, now_s + self.life.exits_s)
        elif now_s >= self._begun_s + self.life.begins_s:
            self._run(now_s)
        quiet = self.life.silent and not self._is_loaded
        if not self._unsaid and not quiet and now_s >= self.heard_s + _PERIOD_S:
            self._say(None)

    def _run(self, now_s: float) -> None:
        if not self._says_begun:
            self._says_begun = True
            self._say(wire.Begun())
        if now_s >= self._begun_s + self.life.fails_s and not self._failing:
            self._failing = sorted(self._ends_at_s)[: self.life.fails]
            self._say(wire.RouteFailed())
        ended = [name for name, at_s in self._ends_at_s.items() if at_s <= now_s]
        if ended:
            for name in ended:
                del self._ends_at_s[name]
            self._failing = [name for name in self._failing if name not in ended]
            self._say(wire.RoutesEnded(tuple(ended)))
        if now_s >= self._drained_at_s or not self._ends_at_s.keys() - self._failing:
            self._exits_at_s = min(self._exits_at_s, now_s + self.life.exits_s)

    def _say(self, event: wire.Event | None) -> None:
        told = b''.join(_told(name, name in self._failing) + b',' for name in self._ends_at_s)
        self._unsaid.append((b'[' + told[:-1] + b']\n', [*self._failing]))
        if event is not None:
            self._unsaid.append((wire.to_line(event), event))

    def _write(self) -> None:
        room = self.life.cut
        while self._unsaid and room:
            data, said = self._unsaid[0]
            try:
                written = os.write(self._pipe, data[:room])
            except BlockingIOError:
                return
            room -= written
            self.heard_s = self.world.now_s
            self._unsaid[0] = data[written:], said
            if written == len(data):
                del self._unsaid[0]
                self.has_begun = self.has_begun or isinstance(said, wire.Begun)
                self.final |= {*said} if isinstance(said, list) else set()


@cache
def _told(name: str, has_failed: bool) -> bytes:  # noqa: FBT001 -- it caches
    snapshot = Counters(name, state=State.RUNNING).snapshot(0)
    if has_failed:
        snapshot = snapshot._replace(state=State.FAILED, reason='a mistake', final=True)
    return counters.to_line([snapshot])[1:-2]
