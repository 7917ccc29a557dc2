"""Who looks after the workers, and after a bridge in one process: what it ends and begins."""

import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest
from harness import eventually
from patience import patient

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.process.child import start_child
from ros2_kafka_bridge.process.crew import Crew
from ros2_kafka_bridge.process.hangup import Signals
from ros2_kafka_bridge.process.local_worker import LocalWorker
from ros2_kafka_bridge.process.operations import OperationResult, Operations
from ros2_kafka_bridge.process.plan import Plan, Rank, RoutePlan, Share, plan_of, write_plan
from ros2_kafka_bridge.process.standalone import Standalone
from ros2_kafka_bridge.process.worker_process import WorkerProcess
from ros2_kafka_bridge.protocol.monitor import Do, Lifecycle
from ros2_kafka_bridge.protocol.worker import Begun
from ros2_kafka_bridge.route.counters import Counters, Snapshot, to_line
from ros2_kafka_bridge.threads.stop import Stop

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


# Workers: real processes in their place, which say what they are to say


class House:
    """A crew and what it is asked for; `turn` is that of its supervisor."""

    def __init__(self, plan: Plan) -> None:
        self.stop = Stop()
        self.selector = selectors.DefaultSelector()
        self.crew = Crew([], self.selector, self.stop)
        self.operations = Operations(plan, self.crew, Lifecycle.ACTIVE, self.stop)
        self.answers: list[OperationResult] = []
        self.plan = write_plan(plan)

    def turn(self) -> None:
        self.crew.tick()
        for key, _ in self.selector.select(0.02):
            key.data()
        self.operations.step()

    def turns_until(self, condition: Callable[[], bool]) -> None:
        def done() -> bool:
            self.turn()
            return condition()

        eventually(done, 60)

    @property
    def runs(self) -> list[list[str]]:
        """The routes of each worker."""
        return sorted(list(worker.snapshots) for worker in self.crew.workers)

    def ask(self, do: Do) -> None:
        self.operations.ask(do, self.answers.append)

    def close(self) -> None:
        for worker in self.crew.workers:
            if isinstance(worker, WorkerProcess) and worker.runs:
                worker.kill()
        self.crew.tick()
        self.crew.close()
        self.operations.release()
        self.selector.close()
        os.close(self.plan)


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
    house.crew.hire([Share(('orders',), Rank.TO_ROS)], house.plan)
    (worker,) = house.crew.workers
    house.turns_until((tmp_path / 'program.been').exists)
    assert not worker.hangs
    assert not house.crew.begun
    first, now_s = worker.pid, time.monotonic
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 100)
    house.turn()
    assert worker.pid == first
    assert not house.crew.begun, 'late is not begun'
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 130)
    house.turns_until(lambda: worker.begun)
    assert worker.starts == 2
    monkeypatch.setattr('time.monotonic', lambda: now_s() + 10_000)
    house.turn()
    assert worker.starts == 2, 'one that has begun may be silent: its routes tell how they are'


def test_a_stop_ends_at_once_who_waits_to_begin_and_keeps_the_counters_of_who_runs(
    house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', 'time.sleep(600)\n'))
    share = Share(('orders',), Rank.TO_ROS)
    runs = WorkerProcess(1, share, -1)
    runs.hear(to_line([Counters('orders', taken=7).snapshot(7)]))
    runs.over = True
    house.crew.workers.append(runs)
    house.crew.hire([share], house.plan, waits=True)
    house.turn()
    assert house.crew.workers[1].runs
    assert [snapshot.taken for snapshot in house.crew.snapshots()] == [7]
    for turns, _ in enumerate(house.crew.drain([LONG], lambda: False)):
        house.crew.tick()
        assert turns < 10, 'it is waited for'
    assert house.crew.last['orders'].taken == 7
    assert house.crew.status == 0


def test_a_stop_in_a_deactivation_does_not_forget_that_something_has_failed_before(
    house: House, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', 'time.sleep(600)\n'))
    house.crew.hire([Share(('orders',), Rank.TO_ROS)], house.plan)
    house.turn()
    house.crew.status = 1
    house.ask(Do.DEACTIVATE)
    house.turn()
    house.operations.close()
    assert [answer.done for answer in house.answers] == [False]
    assert house.crew.status == 1


# The bridge of one process


class OneProcess:
    """As the `Bridge` of a process whose route `a` does not end, until it is let go."""

    def __init__(self) -> None:
        self.routes = ['a', 'b']
        self.stop = Stop()
        self.asked: list[frozenset[str]] = []
        self.paused: frozenset[str] = frozenset()
        self.runs = True

    def snapshots(self) -> list[Snapshot]:
        return [Counters(name).snapshot(0) for name in self.routes]

    def end(self, routes: frozenset[str]) -> None:
        self.asked.append(routes)
        self.routes = [name for name in self.routes if name not in routes or name == 'a']


def test_a_route_that_does_not_end_in_the_first_process_begins_nowhere_else_until_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(TEXT)
    plan = plan_of(loads(TEXT, str(file), {}), file)
    monkeypatch.setattr('sys.executable', program(tmp_path / 'program', OBEYS))
    monkeypatch.setattr('ros2_kafka_bridge.process.crew.CLOSING_S', 0.3)
    bridge = OneProcess()
    with _house(plan) as house:
        house.crew.workers.append(LocalWorker(cast('Bridge', bridge), lambda: None, house.stop))
        file.write_text(TEXT.replace('drain_s: 0.1', 'drain_s: 0.2'))
        house.ask(Do.RELOAD)
        house.turns_until(lambda: bool(house.answers))
        (answer,) = house.answers
        assert not answer.done
        assert answer.text.startswith('a did not end in time, in the first process, which cannot')
        assert 'nothing was changed' in answer.text
        assert house.operations.plan == plan
        assert 'begin' not in (tmp_path / 'program.told').read_text()
        house.turns_until(lambda: house.crew.begun and house.runs == [['a'], ['b']])
        bridge.routes = []
        house.turns_until(lambda: house.crew.begun and house.runs == [[], ['a'], ['b']])


def test_the_first_process_is_asked_for_each_end_once() -> None:
    bridge = OneProcess()
    local = LocalWorker(cast('Bridge', bridge), lambda: None, Stop())
    local.end(['b', 'elsewhere'])
    local.end(['a'])
    assert bridge.asked == [frozenset({'b'}), frozenset({'a'})]
    assert local.leaving == {'a'}


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
    assert Standalone(bridge, ONE, Signals(stop.on_signal), 'text').run(lambda _: None) == 1
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
        [sys.executable, '-m', 'ros2_kafka_bridge.process.difference', f'--plan={plan}'],
        pass_fds=[plan], stdout=its_end, stderr=subprocess.PIPE, timeout=patient(60), check=False,
    )  # fmt: skip
    os.close(its_end)
    os.close(plan)
    assert (done.returncode, done.stderr) == (0, b'')


def test_ctrl_c_is_for_the_supervisor_and_not_for_its_check(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    plan = write_plan(plan_of(loads(TEXT, str(file), {}), file))
    os.mkfifo(file)
    check = start_child('process.difference', [f'--plan={plan}'], [plan], stdout=subprocess.PIPE)
    for number in (signal.SIGINT, signal.SIGHUP):
        check.send_signal(number)
    file.write_text(TEXT)
    said, _ = check.communicate(timeout=patient(60))
    os.close(plan)
    assert check.returncode == 0
    assert said
