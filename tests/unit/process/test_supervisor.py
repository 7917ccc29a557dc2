"""How routes are shared out among workers, when one is started again, what its pipe carries."""

import logging
import math
import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.processes.harness import eventually
from support.worlds.handles import handle, hear

from ros2_kafka_bridge import bridge
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.exclusive.term import HANDOVER_S
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.process.draining import CLOSING_S, drain
from ros2_kafka_bridge.process.lines import LineReader
from ros2_kafka_bridge.process.plan import Plan, Rank, RoutePlan, Share, plan_of, share_out
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.supervisor import Supervisor
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import Begun
from ros2_kafka_bridge.route.counters import Counters, State, from_line, to_line
from ros2_kafka_bridge.threads.backoff import Backoff
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.process.worker_handle import WorkerHandle

CONFIG = """\
name: test
workers: {workers}
kafka: {{bootstrap.servers: x}}
defaults: {{format: text}}
routes:
  - {{name: a, from: {{kafka: a}}, to: {{ros: /a, type: std_msgs/msg/String}}, drain_s: 3}}
  - {{name: b, from: {{ros: /b}}, to: {{kafka: b}}}}
"""


def names(prefix: str, count: int) -> list[str]:
    return [f'{prefix}{number}' for number in range(count)]


def numbers(shares: list[Share]) -> tuple[list[int], list[int]]:
    """How many routes each worker has, to ROS and from ROS."""
    to_ros = [len(share.routes) for share in shares if share.rank is Rank.TO_ROS]
    return to_ros, [len(share.routes) for share in shares if share.rank is Rank.FROM_ROS]


@pytest.mark.parametrize(
    ('to_ros', 'from_ros', 'workers', 'expected'),
    [
        (1, 1, 2, ([1], [1])),
        (1, 1, 8, ([1], [1])),
        (4, 0, 3, ([2, 1, 1], [])),
        (0, 4, 2, ([], [2, 2])),
        (9, 1, 2, ([9], [1])),
        (9, 1, 4, ([3, 3, 3], [1])),
        (1, 9, 4, ([1], [3, 3, 3])),
        (4, 4, 3, ([2, 2], [4])),
    ],
)
def test_each_direction_gets_workers_in_proportion_to_its_routes(
    to_ros: int, from_ros: int, workers: int, expected: tuple[list[int], list[int]]
) -> None:
    assert numbers(share_out(names('a', to_ros), names('b', from_ros), workers)) == expected


@given(
    to_ros=st.integers(0, 30).map(lambda count: names('a', count)),
    from_ros=st.integers(0, 30).map(lambda count: names('b', count)),
    workers=st.integers(2, 40),
)
def test_every_route_has_one_worker_of_its_direction_and_no_worker_is_idle(
    to_ros: list[str], from_ros: list[str], workers: int
) -> None:
    if len(to_ros) + len(from_ros) < 2:
        return
    shares = share_out(to_ros, from_ros, workers)
    assert len(shares) == min(workers, len(to_ros) + len(from_ros))
    assert Counter(r for share in shares for r in share.routes) == Counter(to_ros + from_ros)
    assert all(share.routes for share in shares)
    of = {Rank.TO_ROS: to_ros, Rank.FROM_ROS: from_ros}
    assert all(set(share.routes) <= {*of[share.rank]} for share in shares)
    for counts in numbers(shares):
        assert not counts or max(counts) - min(counts) <= 1


def plan(text: str, *chosen: str) -> Plan:
    return plan_of(loads(text, 'x', {}), Path('x'), frozenset(chosen) or None)


def test_one_worker_or_one_route_needs_no_supervisor_unless_the_bridge_is_watched() -> None:
    two, one = CONFIG.format(workers=2), CONFIG.format(workers=1)
    assert plan(two).supervised
    assert not plan(two, 'a').supervised
    assert not plan(one).supervised
    watched = plan(f'monitoring: {{}}\n{one}')
    assert watched.supervised
    assert watched.shares() == [Share(('a', 'b'), Rank.BOTH)]


def test_workers_share_the_routes_that_are_asked_for() -> None:
    routes = ''.join(
        f'  - {{name: {name}, from: {{ros: /{name}}}, to: {{kafka: {name}}}, drain_s: 2}}\n'
        for name in ('c', 'd')
    )
    text = CONFIG.format(workers=3) + routes
    assert plan(text).drain_s == 8
    asked = plan(text, 'c', 'd')
    assert asked.drain_s == 2
    assert asked.shares() == [Share((name,), Rank.FROM_ROS) for name in ('c', 'd')]


@pytest.mark.parametrize(
    ('number', 'at_once'),
    [(signal.SIGINT, True), (signal.SIGTERM, True), (signal.SIGHUP, False)],
)
def test_a_second_signal_stops_at_once_but_for_that_of_a_closed_terminal(
    number: signal.Signals, *, at_once: bool
) -> None:
    stop = Stop()
    stop.on_signal(number)
    assert stop.asked
    assert not stop.at_once
    stop.on_signal(number)
    assert stop.at_once == at_once


@pytest.mark.parametrize(
    ('status', 'expected'), [(1, 1), (-signal.SIGKILL, 0), (0, 0)], ids=['1', 'killed', '0']
)
def test_a_worker_that_failed_unasked_makes_the_end_a_failure_and_one_that_was_killed_does_not(
    status: int, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real process in the worker's place: it ends so once, and the next one waits for a stop."""
    ending = f'sys.exit({status})' if status >= 0 else f'os.kill(os.getpid(), {-status})'
    been = tmp_path / 'been'
    program = tmp_path / 'program'
    program.write_text(
        f'#!{sys.executable}\n'
        'import os, pathlib, sys\n'
        f'been = pathlib.Path({str(been)!r})\n'
        'if been.exists():\n'
        '    been.with_name("again").touch()\n'
        '    sys.stdin.readline()\n'
        '    sys.exit(0)\n'
        'been.touch()\n'
        f'{ending}\n'
    )
    program.chmod(0o700)
    monkeypatch.setattr('sys.executable', str(program))
    one = Plan('x', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=5.0),))
    with Supervisor(one, [], Systemd(), Signals()) as supervisor:
        ended: list[int] = []
        thread = threading.Thread(target=lambda: ended.append(supervisor.run()), daemon=True)
        thread.start()
        try:
            eventually(been.with_name('again').exists, 30)
        finally:
            supervisor.stop.ask()
            thread.join(30)
    assert ended == [expected]


class SlowWorker:
    """A worker that ends so long after it was asked to drain."""

    waits = is_away = is_over = is_in_process = False

    def __init__(self, route: str, rank: Rank, ends_after_s: float) -> None:
        # It tells all the time, by whatever clock.
        snapshot = Counters(route, taken=7).snapshot(7)._replace(made_s=math.inf)
        self.snapshots = {route: snapshot}
        self.rank = rank
        self.process = self
        self.killed = False
        self._name = route
        self._ends_after_s = ends_after_s
        self._asked_s = math.inf

    def __str__(self) -> str:
        return f'worker ({self._name})'

    @property
    def is_running(self) -> bool:
        return not self.killed and time.monotonic() < self._asked_s + self._ends_after_s

    def drain(self) -> None:
        self._asked_s = min(self._asked_s, time.monotonic())

    def kill(self) -> None:
        self.killed = True

    def close(self) -> None:
        """It has no pipe."""


def drained(
    monkeypatch: pytest.MonkeyPatch, workers: list[SlowWorker], routes: list[RoutePlan]
) -> float:
    """Drain these workers by a clock that does not wait; tells how long it took."""
    now_s = [1000.0]
    monkeypatch.setattr('time.monotonic', lambda: now_s[0])
    with selectors.DefaultSelector() as selector:
        pool = WorkerPool(Plan('x', {}, tuple(routes)), [], selector, Stop())
        pool.workers += [cast('WorkerHandle', worker) for worker in workers]
        for _ in drain(pool, lambda: False):
            now_s[0] += 0.1
        pool.close()
    return now_s[0] - 1000


def test_workers_from_ros_have_their_whole_drain_however_long_those_to_ros_take(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    stuck = SlowWorker('a', Rank.TO_ROS, math.inf)
    slow = SlowWorker('b', Rank.FROM_ROS, 70.0)
    routes = [
        RoutePlan('a', Direction.KAFKA_TO_ROS, drain_s=60),
        RoutePlan('b', Direction.ROS_TO_KAFKA, drain_s=60),
    ]
    took_s = drained(monkeypatch, [stuck, slow], routes)
    assert stuck.killed
    assert not slow.killed
    assert took_s < 2 * 60 + 50
    of_worker, of_route = caplog.records
    assert of_worker.getMessage() == 'worker (a) did not end in time and was killed'
    assert vars(of_route)['route'] == 'a'
    assert of_route.getMessage() == (
        'its worker was killed: it is left with 7 records in flight, read again next time '
        '(7 taken, 0 confirmed, 0 dead-lettered, 7 given up)'
    )


def test_a_worker_of_both_directions_has_the_time_of_both(monkeypatch: pytest.MonkeyPatch) -> None:
    both = SlowWorker('a', Rank.BOTH, 60 + bridge._CLOSING_S + 8 + HANDOVER_S + bridge._CLOSING_S)
    routes = [
        RoutePlan('a', Direction.KAFKA_TO_ROS, drain_s=60),
        RoutePlan('b', Direction.ROS_TO_KAFKA, drain_s=8),
    ]
    drained(monkeypatch, [both], routes)
    assert not both.killed


def test_a_worker_is_given_more_time_than_it_takes_itself() -> None:
    assert CLOSING_S > bridge._CLOSING_S + HANDOVER_S


def test_an_error_that_stays_is_said_once_and_a_new_one_at_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 1000.0
    monkeypatch.setattr('time.monotonic', lambda: now_s)
    errors = summed(logging.LoggerAdapter(logging.getLogger('test')), 1, 60.0)
    for wait_s in (1, 2, 4):
        errors.error('failed: away', f'; tried again in {wait_s} s')
    errors.error('failed: refused', '; tried again in 8 s')
    errors.error('failed: refused', '; tried again in 9 s')
    errors.error('failed: away', '; tried again in 10 s')
    now_s += 61
    errors.error('failed: refused', '; tried again in 10 s')
    assert caplog.messages == [
        'failed: away; tried again in 1 s',
        'failed: refused; tried again in 8 s',
        'failed: refused (2 times more); tried again in 10 s',
    ]


def test_the_wait_for_a_start_doubles_up_to_ten_seconds_and_begins_anew_after_a_good_time() -> (
    None
):
    waits = [Backoff()]
    for _ in range(6):
        waits.append(waits[-1].after(ran_s=2.0))
    assert [wait.wait_s for wait in waits] == [0.0, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    assert waits[-1].after(ran_s=3600.0) == Backoff(1.0)


def test_a_line_of_snapshots_brings_back_every_field() -> None:
    counters = Counters('orders', state=State.WAITING, reason='a "subscriber"\nis away', taken=7)
    sent = [
        counters.snapshot(7, lag=3),
        Counters('ü').snapshot(0)._replace(state=State.FAILED, final=True),
    ]
    line = to_line(sent)
    assert line.count(b'\n') == 1
    assert line.endswith(b'\n')
    received = from_line(line)
    assert received == sent
    assert received[0].state is State.WAITING


def test_what_a_worker_has_said_last_is_known_however_its_lines_are_cut() -> None:
    worker = handle('orders')
    counters = Counters('orders')
    lines = []
    for _ in range(3):
        counters.taken += 1
        lines.append(to_line([counters.snapshot(counters.taken)]))
    data = b''.join(lines)
    pipe, its_end = os.pipe()
    reader = LineReader(pipe)
    for start in range(0, len(data) - 5, 7):
        os.write(its_end, data[start : min(start + 7, len(data) - 5)])
        worker.on_lines(reader.read())
    os.close(pipe)
    os.close(its_end)
    assert worker.snapshots['orders'].taken == 2


def test_a_dead_worker_is_due_after_its_wait_and_its_routes_say_so() -> None:
    worker = handle('orders', 'bad')
    assert worker.is_due
    bad = Counters('bad').snapshot(0)._replace(state=State.FAILED, reason='NUL', final=True)
    hear(worker, to_line([bad]))
    assert worker.start_later('was ended by SIGKILL') == 1.0
    assert not worker.is_due
    assert worker.snapshots['bad'] == bad
    assert worker.failed_for_good == ['bad']
    orders = worker.snapshots['orders']
    assert orders.state is State.FAILED
    assert orders.reason == 'its worker was ended by SIGKILL and is started again'


class Life:
    """A worker whose process lives for as long as the clock of the test says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        self.worker = handle('orders')
        monkeypatch.setattr('time.monotonic', lambda: self.now_s)
        monkeypatch.setattr(
            'ros2_kafka_bridge.process.child_process._start',
            lambda *_: subprocess.Popen(['true'], stdin=subprocess.PIPE, bufsize=0),
        )

    def wait_after(self, starts_s: float, runs_s: float | None = None) -> float:
        """The pause behind a life that begins after `starts_s`, if at all, and ends in failure."""
        self.worker.start(Plan('x', {}, ()), [], [])
        self.now_s += starts_s
        if runs_s is not None:
            hear(self.worker, wire.to_line(Begun()))
            self.now_s += runs_s
        self.worker.kill()
        self.worker.process.exit_status()
        wait_s = self.worker.start_later('ended with status 2')
        self.now_s += wait_s
        return wait_s


@pytest.mark.parametrize('starts_s', [0.5, 40.0, 130.0])
def test_the_pause_before_a_worker_that_fails_in_its_start_grows_however_long_that_takes(
    starts_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    life = Life(monkeypatch)
    assert [life.wait_after(starts_s) for _ in range(6)] == [1.0, 2.0, 4.0, 8.0, 10.0, 10.0]


def test_only_the_time_that_a_worker_ran_makes_its_pause_short_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    life = Life(monkeypatch)
    assert [life.wait_after(40.0, runs_s=1.0) for _ in range(3)] == [1.0, 2.0, 4.0]
    assert life.wait_after(1.0, runs_s=40.0) == 1.0
    assert life.wait_after(1.0) == 2.0


def test_the_supervisor_loads_no_ros_no_kafka_client_and_no_settings() -> None:
    program = (
        'import sys; import ros2_kafka_bridge.process.supervisor\n'
        'heavy = {"rclpy", "confluent_kafka", "pydantic", "ruamel.yaml", "typer", "rich"}\n'
        'assert not heavy & {*sys.modules}, heavy & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)
