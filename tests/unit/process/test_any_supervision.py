"""Whatever happens to the workers of a bridge: who runs a route, how it ends, and what is said.

The supervisor is real; what it starts, and its time, are of a world (`supervised_worlds.py`).
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds.supervised_processes import NEVER, File, Life, Worker
from support.worlds.supervised_worlds import (
    LATER,
    LIVES,
    TICK_S,
    Event,
    World,
    a_world,
    all_files,
    any_of,
    files_of,
    open_files,
    settings_of,
)

from ros2_kafka_bridge import bridge
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.exclusive.term import HANDOVER_S
from ros2_kafka_bridge.process.plan import RoutePlan
from ros2_kafka_bridge.protocol.monitor import Answer, Do, Lifecycle, Request
from ros2_kafka_bridge.protocol.worker import Begin, Drain, End, WorkerOrder

# What workers are given, at least: supervisors give a little more than they take themselves.
ENDING_S: Final = bridge._CLOSING_S
AT_ONCE_S: Final = bridge._AT_ONCE_S
MORE_S: Final = 2.0
SILENT_S: Final = 120.0
BEGIN_S: Final = 600.0
LONGEST_WAIT_S: Final = 10.0
CANNOT_START: Final = 2
SLACK_S: Final = 4 * TICK_S
TO_ROS: Final = Direction.KAFKA_TO_ROS
FROM_ROS: Final = Direction.ROS_TO_KAFKA
STEPS: Final = {
    Do.CONFIGURE: (Lifecycle.UNCONFIGURED, Lifecycle.INACTIVE),
    Do.ACTIVATE: (Lifecycle.INACTIVE, Lifecycle.ACTIVE),
    Do.DEACTIVATE: (Lifecycle.ACTIVE, Lifecycle.INACTIVE),
    Do.CLEANUP: (Lifecycle.INACTIVE, Lifecycle.UNCONFIGURED),
}


def ending_s(routes: Iterable[RoutePlan]) -> float:
    """How long routes may take to end: to ROS first."""
    longest_s: dict[Direction, float] = {}
    for it in routes:
        longest_s[it.direction] = max(longest_s.get(it.direction, 0.0), it.drain_s)
    handover_s = HANDOVER_S if FROM_ROS in longest_s else 0.0
    return sum(longest_s.values()) + len(longest_s) * ENDING_S + handover_s


class Judge:
    """Says what must not be, as soon as it is."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.plan = world.bridge.plan
        self.lifecycle = world.bridge.lifecycle
        self.paused: set[str] = set()
        self.answers: Counter[int] = Counter()
        self.requests = 0
        self.stopped_s = self.at_once_s = NEVER
        self.least, self.most = 0, 0  # the exit status
        self.begun_s = NEVER
        self.asked_s = world.now_s  # when anything was being done
        self.away_s: dict[str, float] = {}  # since when nobody has a route
        self.died: dict[str, tuple[float, int]] = {}  # of routes: when, and how
        self.refused: set[str] = set()  # routes that are never begun
        self.failed_s: dict[str, float] = {}  # for good
        self.numbers: set[int] = set()  # of workers that were started before

    @property
    def now_s(self) -> float:
        return self.world.now_s

    @property
    def is_active(self) -> bool:
        """Whether routes are to run, and nobody has asked for anything else."""
        it = self.world.bridge
        return it.lifecycle is Lifecycle.ACTIVE and not it.is_busy and not it.is_stopping

    # Starts

    def started(self, worker: Worker) -> None:
        assert worker.began_paused == self.paused & {*worker.routes}
        assert self.stopped_s == NEVER, 'it is started behind a stop'
        assert worker.options['--routes'], 'without any it takes all for its own'
        for name in worker.routes:
            died_s, _ = self.died.pop(name, (-NEVER, 0))
            assert self.now_s >= died_s + 1 or died_s <= self.asked_s
            final = self.asked_s < self.failed_s.get(name, -NEVER)
            assert not final, f'{name} has failed for good, and is started again'
            if worker.may_begin:
                self.failed_s.pop(name, None)
            self.away_s[name] = self.now_s
            self.refused.discard(name)

    def not_started(self, routes: Sequence[str]) -> None:
        self.died |= dict.fromkeys(routes, (self.now_s, -1))
        self.away_s |= dict.fromkeys(routes, self.now_s)
        self.most = 2

    # Ends

    def told(self, worker: Worker, order: WorkerOrder) -> None:
        others = [it for it in self.world.workers if it is not worker and it.may_begin]
        match order:
            case Begin():
                for name in worker.routes:
                    self.failed_s.pop(name, None)
            case End(names):
                self._look_at_end_of({*names}, worker, others)
            case Drain() if worker.may_begin and self.at_once_s == NEVER:
                for it in [it for it in others if self.rank(it) < self.rank(worker)]:
                    assert it.drain_s or it.was_full, f'{worker.routes} drain before {it.routes}'
                    asked_s = self.stopped_s if it.was_full else it.drain_s[0]
                    assert self.now_s - asked_s >= self.limit_s(it)
            case _:
                pass

    def _look_at_end_of(self, names: set[str], worker: Worker, others: Sequence[Worker]) -> None:
        found = self.world.checked.difference
        assert not names & {*found.unchanged}
        assert names <= {*worker.routes}, 'it has no such route, and never tells that it has ended'
        if self.routes(names, FROM_ROS):
            for route in self.routes({*found.removed, *found.changed}, TO_ROS):
                for it in [it for it in (*others, worker) if route.name in it.has]:
                    told_s = it.end_s.get(route.name, NEVER)
                    assert self.now_s - told_s >= ending_s([route]), 'from ROS ends first'

    def rank(self, worker: Worker) -> int:
        return [TO_ROS, None, FROM_ROS].index(worker.direction)

    def routes(self, names: Iterable[str], direction: Direction) -> list[RoutePlan]:
        return [x for x in self.plan.routes if x.name in {*names} and x.direction is direction]

    def limit_s(self, worker: Worker) -> float:
        """How long it may take to end what it still has."""
        has = [route for route in worker.plan.routes if route.name in worker.has]
        return max(ENDING_S, ending_s(has))

    def killed(self, worker: Worker) -> None:
        """Nobody is killed before its time."""
        if not worker.lives:  # as its supervisor may not have seen yet
            self.most = max(self.most, 1)
            return
        asked_s = min(worker.drain_s, default=NEVER)
        late = [
            route
            for route in worker.plan.routes
            # As above, and so one is killed whose own routes have all ended, or run on.
            if (route.name in worker.has or route.name not in worker.routes)
            and self.now_s - worker.end_s.get(route.name, NEVER) >= ending_s([route])
        ]
        since_s = max(worker.heard_s, worker.begin_s)
        assert (
            late
            or self.now_s - asked_s >= self.limit_s(worker)
            or (worker.was_full and self.now_s - self.stopped_s >= self.limit_s(worker))
            or self.now_s - self.at_once_s >= AT_ONCE_S
            or (not worker.has_begun and self.now_s - since_s > SILENT_S)
            or (not worker.has_begun and self.now_s - worker.begin_s > BEGIN_S)
            or (not worker.may_begin and self.world.bridge.is_stopping)
            or (not worker.may_begin and self.now_s - asked_s >= ENDING_S)
        ), f'{worker.routes} has not had its time'

    def ended(self, worker: Worker) -> None:
        self.failed_s |= dict.fromkeys(worker.final, self.now_s)
        if worker.has_begun:
            self.begun_s = min(self.begun_s, worker.heard_s)
        self._note_status(worker, worker.status or 0)
        self.numbers.add(worker.number)
        if worker.may_begin and not worker.drain_s:
            lost = worker.has_at_end - worker.final - worker.end_s.keys()
            self.died |= dict.fromkeys(lost, (self.now_s, worker.status or 0))

    def _note_status(self, worker: Worker, status: int) -> None:
        """Note what the end of a worker means for that of the bridge."""
        it = self.world.bridge
        if not worker.may_begin:
            self.most = max(self.most, 1 if status else 0)
        elif status == 1 or (status and worker.drain_s) or worker.final - worker.end_s.keys():
            self.least = max(self.least, 1)
        elif worker.final:
            self.most = max(self.most, 1)
        elif status == CANNOT_START and self._is_first(worker):
            if self.begun_s == NEVER and self.is_active:
                self.least = CANNOT_START
            self.most = CANNOT_START
        elif status and (it.is_stopping or it.is_busy):
            self.most = max(self.most, 1)

    def _is_first(self, worker: Worker) -> bool:
        """Whether a worker may have ended before anything has begun, in its first start."""
        left = worker.has_at_end - worker.end_s.keys()
        return bool(left) and worker.number not in self.numbers and self.begun_s >= self.now_s

    def asked(self, request: Request) -> None:
        self.requests += 1
        self._note_doing(request)

    def _note_doing(self, request: Request) -> None:
        if request.do not in (Do.PAUSE, Do.RESUME):
            self.asked_s = self.now_s

    def answered(self, request: Request, answer: Answer) -> None:
        """Each is answered once, and what is done counts."""
        self.answers[request.number] += 1
        self._note_doing(request)
        assert answer.number == request.number
        assert answer.text
        checked, do = self.world.checked, request.do
        if do in (Do.PAUSE, Do.RESUME):
            assert answer.done == (request.route in self.plan.names)
        if do in STEPS:
            before, after = STEPS[do]
            refused = do is Do.CONFIGURE and checked.plan is None
            may = before is self.lifecycle and not self.world.bridge.is_stopping and not refused
            assert answer.done == may
            self.lifecycle = after if answer.done else self.lifecycle
        if not answer.done:
            return
        match do:
            case Do.PAUSE:
                self.paused.add(request.route)
            case Do.RESUME:
                self.paused.discard(request.route)
            case Do.RELOAD | Do.CONFIGURE:
                assert checked.plan is not None
                self.plan = checked.plan
                self.paused &= {*self.plan.names}
            case Do.DEACTIVATE:
                assert not self.world.workers, 'some run in a bridge that is inactive'
                self.most = max(self.most, 1 if self.died else 0)
            case _:
                pass

    # All the time

    def turned(self) -> None:
        it, workers = self.world.bridge, self.world.workers
        running = Counter(name for worker in workers for name in worker.runs)
        assert max(running.values(), default=0) <= 1, f'twice at once: {running}'
        for worker in workers:
            if worker.has_begun:
                self.begun_s = min(self.begun_s, self.now_s)
            for name in worker.final:
                self.failed_s.setdefault(name, self.now_s)
        for name in self._here():
            self.died.pop(name, None)
        if it.is_busy:
            self.asked_s = self.now_s
            self.away_s.clear()
        if it.is_stopping:
            self._stopping()
        elif not it.is_busy:
            assert it.plan == self.plan
            assert it.lifecycle is self.lifecycle
            if it.lifecycle is Lifecycle.ACTIVE:
                self._active()
            else:
                assert not workers

    def _active(self) -> None:
        owned = Counter(self.world.bridge.owned)
        assert owned == Counter(self.plan.names), 'each route has one worker'
        here = self._here()
        self.refused -= here
        for name in self.plan.names:
            if name in here or name in self.failed_s.keys() | self.refused:
                self.away_s[name] = self.now_s
            away_s = self.now_s - self.away_s.setdefault(name, self.now_s)
            assert away_s <= LONGEST_WAIT_S + SLACK_S, f'{name} is not started again'

    def _here(self) -> set[str]:
        """The routes that somebody runs, or is to run."""
        return {name for worker in self.world.workers for name in worker.has}

    def _stopping(self) -> None:
        it = self.world.bridge
        if self.stopped_s == NEVER:
            self.stopped_s = self.now_s
            away = [self.died[n] for n in self.plan.names if n in self.died]
            if it.is_busy or any(at_s == self.now_s for at_s, _ in away):
                self.most = max(self.most, 1 if self.died else 0)
            elif away and it.lifecycle is Lifecycle.ACTIVE:
                self.least = max(self.least, 1)
        waits = any(not worker.may_begin for worker in self.world.workers)
        assert not waits or self.now_s <= self.stopped_s + SLACK_S, 'they hold nothing'
        longest_s = max(route.drain_s for file in self.world.files for route in file.routes)
        limit_s = 2 * (2 * longest_s + 2 * (ENDING_S + MORE_S) + HANDOVER_S) + SLACK_S
        assert self.now_s - self.stopped_s <= limit_s
        assert self.now_s - self.at_once_s <= 3 * (AT_ONCE_S + MORE_S + 1) + SLACK_S

    def is_settled(self) -> bool:
        """Whether all is as it should be in the end."""
        it, workers = self.world.bridge, self.world.workers
        if it.is_busy:
            return False
        if it.lifecycle is not Lifecycle.ACTIVE:
            return True
        running = {name: worker for worker in workers for name in worker.runs}
        return (
            running.keys() | self.failed_s.keys() | self.refused >= {*self.plan.names}
            and all(worker.is_up_to_date for worker in running.values())
            and all(worker.paused & worker.runs == self.paused & worker.runs for worker in workers)
            and all(
                settings_of(worker.plan, name) == settings_of(self.plan, name)
                for name, worker in running.items()
            )
        )

    def look_at_end(self, status: int) -> None:
        world = self.world
        assert all(process.returncode is not None for process in world.processes)
        for it in world.processes:
            # That of one that is killed at the very end is closed with the last reference to it.
            assert it.is_killed or it.stdin.closed
        assert self.answers == Counter(range(1, self.requests + 1))
        # Not promised: one that dies while others drain, and is not started again, is no failure.
        most = max(self.least, self.most)
        assert self.least <= status <= most, f'{status}: {self.least} to {most}'
        given_up = self.failed_s.keys() | self.refused
        assert world.bridge.is_stopping or given_up >= {*self.plan.names}, 'it ends by itself'


def live(files: Sequence[File], lives: Sequence[Life], happens: Sequence[Event]) -> None:
    """Let it all happen, and judge it."""
    before = open_files()
    with a_world(files, lives, happens) as world:
        world.judge = judge = Judge(world)
        judge.look_at_end(world.bridge.run())
    assert not open_files() - before, 'a file is left open'


OFTEN = 80
WORKERS = ('crash', 'crash', 'no room', 'pause', 'resume', 'flood', 'flood', 'stop', 'stop')
RELOADS = (*('reload',) * 5, 'preview', 'crash', 'pause', 'pause', 'resume', 'stop')
AWAY = [Event('reload', which=1, after_s=3.5)]
STEPS_OF_LIFE = (
    *('deactivate', 'activate', 'activate', 'cleanup', 'configure', 'configure'),
    *('reload', 'crash', 'pause', 'resume'),
)


@settings(max_examples=OFTEN)
@given(all_files(changes=False), LIVES, any_of(*WORKERS))
def test_whatever_workers_do_each_route_is_run_by_one_and_ends_in_its_turn_and_time(
    files: list[File], lives: list[Life], happens: list[Event]
) -> None:
    live(files, lives, happens)


@settings(max_examples=OFTEN)
@example(files_of('ab', 'ac'), [Life(fails_s=0.0, dies_s=3.25, status=-9)], AWAY)
@given(all_files(), LATER, any_of(*RELOADS, least=3))
def test_whatever_happens_in_a_reload_no_route_runs_twice_and_those_run_that_count(
    files: list[File], lives: list[Life], happens: list[Event]
) -> None:
    live(files, lives, happens)


@settings(max_examples=OFTEN)
@given(
    st.booleans().flatmap(lambda it: all_files(starts=it)), LATER, any_of(*STEPS_OF_LIFE, least=3)
)
def test_whatever_a_bridge_is_asked_for_each_request_has_one_answer_that_is_true(
    files: list[File], lives: list[Life], happens: list[Event]
) -> None:
    live(files, lives, happens)
