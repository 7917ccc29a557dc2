"""Who looks after the workers, and after a bridge in one process: what it ends and begins."""

import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest
from support.patience import patient
from support.processes.harness import eventually
from support.worlds.handles import hear

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.control_plane import ControlPlane
from ros2_kafka_bridge.process.draining import drain
from ros2_kafka_bridge.process.in_process_worker import InProcessWorker
from ros2_kafka_bridge.process.plan import Plan, Rank, RoutePlan, Share, plan_of, write_plan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.single_process import run_in_process
from ros2_kafka_bridge.process.supervisor import Supervisor
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.process.worker_handle import WorkerHandle
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.protocol.monitor import Answer, Do, Lifecycle
from ros2_kafka_bridge.protocol.worker import Begun, Event, RoutesEnded
from ros2_kafka_bridge.route.counters import Counters, Snapshot, to_line
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.threads.wakeup import Wakeup

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge

TEXT = """\
name: test
kafka: {bootstrap.servers: x}
defaults: {format: text}
routes:
  - {name: a, from: {ros: /a}, to: {kafka: a}, drain_s: 0.1}
  - {name: b, from: {ros: /b}, to: {kafka: b}, drain_s: 0.1}
"""
LONG = RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=600.0)
ONE = Plan('x', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=0.1),))
LOADED = '{"type":"loaded"}'
BEGUN = '{"type":"begun"}'
CHECK = (sys.executable, '-m', 'ros2_kafka_bridge.process.config_diff')


# Workers: real processes in their place, which say what they are to say


class House:
    """Workers and what they are asked for; `turn` is that of their supervisor."""

    def __init__(self, plan: Plan) -> None:
        self.stop = Stop()
        self.selector = selectors.DefaultSelector()
        self.pool = WorkerPool(plan, [], self.selector, self.stop)
        self.control = ControlPlane(self.pool, Lifecycle.ACTIVE, self.stop)
        self.answers: list[Answer] = []

    def turn(self) -> None:
        self.control.step()
        self.pool.tick()
        self.selector.select(0.02)

    def turns_until(self, condition: Callable[[], bool]) -> None:
        def done() -> bool:
            self.turn()
            return condition()

        eventually(done, 60)

    @property
    def runs(self) -> list[list[str]]:
        """The routes of each worker."""
        return sorted(list(worker.snapshots) for worker in self.pool.workers)

    def ask(self, do: Do) -> None:
        self.control.enqueue(do, self.answers.append)

    def close(self) -> None:
        for worker in self.pool.workers:
            if not worker.is_in_process:
                worker.kill()
        self.pool.close()
        self.selector.close()


@pytest.fixture
def house() -> Iterator[House]:
    with _house(ONE) as it:
        yield it


@contextmanager
def _house(plan: Plan) -> Iterator[House]:
    it = House(plan)
    try:
        yield it
    finally:
        it.close()


def program(path: Path, life: str) -> str:
    """A Python whose workers live so: `told` is what each was told, `say` tells its supervisor."""
    path.write_text(
        f'#!{sys.executable}\n'
        'import os, pathlib, sys, time\n'
        'if "ros2_kafka_bridge.process.worker" not in sys.argv:\n'
        f'    os.execv({sys.executable!r}, [{sys.executable!r}, *sys.argv[1:]])\n'
        'pipe = next(int(w[12:]) for w in sys.argv if w.startswith("--snapshots="))\n'
        'def say(line): os.write(pipe, line.encode() + b"\\n")\n'
        f'def note(line): open({str(path.with_suffix(".told"))!r}, "a").write(line + "\\n")\n'
        f'been = pathlib.Path({str(path.with_suffix(".been"))!r})\n'
        f'{life}'
    )
    path.chmod(0o700)
    return str(path)


OBEYS = f"""\
say('{LOADED}')
if '--waits' not in sys.argv: say('{BEGUN}')
for line in sys.stdin:
    note(line.strip())
    if 'drain' in line: break
"""


def test_a_worker_that_says_nothing_in_its_start_is_killed_and_nobody_is_told_that_it_has_begun(
    house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    life = f"""\
if not been.exists():
    been.touch()
    time.sleep(600)
{OBEYS}"""
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', life))
    house.turns_until((tmp_path / 'program.been').exists)
    (worker,) = house.pool.workers
    assert not worker.hangs
    assert not house.pool.has_begun
    first, now_s = worker.process.pid, time.monotonic
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 100)
    house.turn()
    assert worker.process.pid == first
    assert not house.pool.has_begun, 'late is not begun'
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 130)
    house.turns_until(lambda: worker.has_begun)
    assert worker.starts == 2
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 10_000)
    house.turn()
    assert worker.starts == 2, 'one that has begun may be silent: its routes tell how they are'


def test_a_stop_ends_at_once_who_waits_to_begin_and_keeps_the_counters_of_who_runs(
    house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', 'time.sleep(600)\n'))
    share = Share(('orders',), Rank.TO_ROS)
    (runs,) = house.pool.add([share])
    hear(runs, to_line([Counters('orders', taken=7).snapshot(7)]))
    runs.is_over = True
    house.pool.add([share], awaits=ONE)
    house.turn()
    assert house.pool.workers[1].process.is_running
    assert [snapshot.taken for snapshot in house.pool.snapshots()] == [7]
    for turns, _ in enumerate(drain(house.pool, lambda: False)):
        house.pool.tick()
        assert turns < 10, 'it is waited for'
    assert house.pool.last['orders'].taken == 7
    assert house.pool.status == 0


def test_a_stop_in_a_deactivation_does_not_forget_that_something_has_failed_before(
    house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', 'time.sleep(600)\n'))
    house.turn()
    house.pool.failures = 1
    house.ask(Do.DEACTIVATE)
    house.turn()
    house.control.close()
    assert [answer.done for answer in house.answers] == [False]
    assert house.pool.status == 1


# The bridge of one process


class OneProcess:
    """As the `Bridge` of a process whose route `a` does not end, until it is let go."""

    def __init__(self) -> None:
        self.stop = Stop()
        self.asked: list[frozenset[str]] = []
        self._tell: Callable[[Event], None] = lambda _: None
        self._has_begun = threading.Event()
        self._leaves = threading.Event()

    def as_worker(self, wakeup: Wakeup | None = None) -> InProcessWorker:
        """The same as a worker that runs."""
        worker = InProcessWorker(cast('Bridge', self), wakeup or Wakeup(), tells_often=False)
        threading.Thread(target=worker.run, args=(self._tell,), daemon=True).start()
        assert self._has_begun.wait(patient(60))
        return worker

    def run(self, tell: Callable[[Event], None]) -> int:
        self._tell = tell
        tell(Begun())
        self._has_begun.set()
        self._leaves.wait(patient(60))
        return 0

    def leave(self) -> None:
        """End at last, with all routes."""
        self.finish(['a', 'b'])
        self._leaves.set()

    def snapshots(self) -> list[Snapshot]:
        return []

    def end(self, routes: frozenset[str]) -> None:
        self.asked.append(routes)
        self.finish(routes - {'a'})

    def finish(self, routes: Iterable[str]) -> None:
        self._tell(RoutesEnded(tuple(routes)))


def test_a_route_that_does_not_end_in_the_first_process_begins_nowhere_else_until_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(TEXT)
    plan = plan_of(loads(TEXT, str(file), {}), file)
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', OBEYS))
    monkeypatch.setattr('ros2_kafka_bridge.process.draining.CLOSING_S', 0.3)
    bridge = OneProcess()
    with _house(plan) as house:
        house.pool.add_own(bridge.as_worker())
        file.write_text(TEXT.replace('drain_s: 0.1', 'drain_s: 0.2'))
        house.ask(Do.RELOAD)
        house.turns_until(lambda: bool(house.answers))
        (answer,) = house.answers
        assert not answer.done
        assert answer.text.startswith('a did not end in time, in the first process, which cannot')
        assert 'nothing was changed' in answer.text
        assert house.pool.plan == plan
        assert 'begin' not in (tmp_path / 'program.told').read_text()
        house.turns_until(lambda: house.pool.has_begun and house.runs == [['a'], ['b']])
        bridge.finish(['a'])
        house.turns_until(lambda: house.pool.has_begun and house.runs == [[], ['a'], ['b']])


def test_a_refused_reload_does_not_end_a_bridge_whose_first_process_ends_behind_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For a moment nobody has a route; the one that was held begins again as it was."""
    file = tmp_path / 'bridge.yaml'
    text = TEXT[: TEXT.index('  - {name: b')]
    file.write_text(text)
    plan = plan_of(loads(text, str(file), {}), file)
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', OBEYS))
    monkeypatch.setattr('ros2_kafka_bridge.process.draining.CLOSING_S', 0.3)
    bridge, signals = OneProcess(), Signals()
    answers: list[Answer] = []
    with Supervisor(plan, [], Systemd(), signals, bridge.as_worker(signals.wakeup)) as supervisor:
        beside = threading.Thread(target=supervisor.run, daemon=True)
        beside.start()
        file.write_text(text.replace('drain_s: 0.1', 'drain_s: 0.2'))
        supervisor.control.enqueue(Do.RELOAD, answers.append)
        signals.wakeup.ring()
        eventually(lambda: bool(answers), 60)
        assert not answers[0].done
        bridge.leave()
        eventually(lambda: supervisor.pool.snapshots() != [] and supervisor.pool.has_begun, 60)
        assert beside.is_alive()
        supervisor.stop.ask()
        beside.join(patient(60))
        assert not beside.is_alive()


def test_the_first_process_is_asked_for_each_end_once() -> None:
    bridge = OneProcess()
    own = WorkerHandle(0, Share(('a', 'b'), Rank.BOTH), bridge.as_worker())
    own.end(['b', 'elsewhere'])
    own.end(['a'])
    own.on_lines(own.process.exchange())
    assert bridge.asked == [frozenset({'b'}), frozenset({'a'})]
    assert own.leaving == {'a'}


def test_a_bug_in_what_hears_the_signals_ends_the_bridge_with_1(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'nobody'))  # else nothing is looked at
    stop = Stop()

    def fails() -> list[Snapshot]:
        raise RuntimeError('a bug')

    def run(tell: Callable[[Begun], None]) -> int:
        tell(Begun())
        assert stop.wait(patient(60)), 'it goes on, and nobody could stop it'
        return 0

    bridge = cast('Bridge', SimpleNamespace(stop=stop, snapshots=fails, run=run))
    assert run_in_process(bridge, ONE, Signals(), 'text', lambda _: None) == 1
    assert 'a bug of the bridge ends it' in caplog.text
    assert not stop.at_once


# The check


def test_a_check_that_nobody_waits_for_any_more_ends_without_a_word(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(TEXT)
    plan = write_plan(plan_of(loads(TEXT, str(file), {}), file))
    pipe, its_end = os.pipe()
    os.close(pipe)
    done = subprocess.run(
        [*CHECK, f'--plan={plan}', '--result=1'],
        pass_fds=[plan], stdout=its_end, stderr=subprocess.PIPE, timeout=patient(60), check=False,
    )  # fmt: skip
    os.close(its_end)
    os.close(plan)
    assert (done.returncode, done.stderr) == (0, b'')


def test_ctrl_c_is_for_the_supervisor_and_not_for_its_check(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    plan = write_plan(plan_of(loads(TEXT, str(file), {}), file))
    os.mkfifo(file)
    with selectors.DefaultSelector() as selector:
        check = ChildProcess('process.config_diff', 'result', selector)
        check.start([f'--plan={plan}'], [plan])
        for number in (signal.SIGINT, signal.SIGHUP):
            os.kill(check.pid, number)
        file.write_text(TEXT)
        ended: list[int | None] = []

        def has_ended() -> bool:
            ended.append(check.exit_status())
            return ended[-1] is not None

        eventually(has_ended, 60)
        assert ended[-1] == 0
        assert check.exchange()
        check.close()
    os.close(plan)
