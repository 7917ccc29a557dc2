"""What a worker tells its supervisor, and what systemd is told, however full their queues are."""

import fcntl
import itertools
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from support.worlds.handles import handle, hear

from ros2_kafka_bridge.process.reports import in_words, is_live
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.process.worker import SnapshotSender
from ros2_kafka_bridge.protocol.limits import STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.protocol.worker import EVENTS, RoutesEnded
from ros2_kafka_bridge.route.counters import (
    Counters,
    Measures,
    Snapshot,
    State,
    from_line,
    to_line,
)

# What a worker tells


def test_an_event_arrives_whole_however_full_the_pipe_of_the_snapshots_is() -> None:
    pipe, its_end = os.pipe()
    fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(pipe, False)
    routes = [Counters(f'route_{number}').snapshot(0) for number in range(24)]
    assert 4096 < len(to_line(routes)) < 3 * 4096
    sender = SnapshotSender(its_end, lambda: routes, events=True)
    data = b''
    for number in range(20):
        sender.send(RoutesEnded((str(number),)))
        data += _all_of(pipe)
    while more := _more(sender, pipe):
        data += more
    *lines, rest = data.split(b'\n')
    events = [EVENTS.decode(line) for line in lines if line.startswith(b'{')]
    assert rest == b''
    assert events[:20] == [RoutesEnded((str(number),)) for number in range(20)]
    for line in [line for line in lines if not line.startswith(b'{')]:
        assert len(from_line(line)) == len(routes)
    os.close(pipe)
    os.close(its_end)


def _more(sender: SnapshotSender, pipe: int) -> bytes:
    sender._writer.flush()
    return _all_of(pipe)


def _all_of(pipe: int) -> bytes:
    data = b''
    try:
        while chunk := os.read(pipe, 4096):
            data += chunk
    except BlockingIOError:
        pass
    return data


# What systemd is told


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(tmp_path / 'notify'))
        end.setblocking(False)  # noqa: FBT003 (the standard library's)
        yield end


def fill(manager: socket.socket) -> None:
    """Fill its queue, which on many machines takes more than one sender has room for."""
    while _send_all(manager.getsockname()):
        pass


def _send_all(address: str) -> int:
    """Send as much as a new socket can; returns how many words that were."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.setblocking(False)  # noqa: FBT003 (the standard library's)
        for sent in itertools.count():
            try:
                other.sendto(b'full', address)
            except BlockingIOError:
                return sent
    raise AssertionError  # it counts on for ever


def heard(manager: socket.socket) -> list[str]:
    """The first line of each word since this was asked last."""
    found = []
    try:
        while True:
            found.append(manager.recv(4096).decode().split('\n')[0])
    except BlockingIOError:
        return [line for line in found if line != 'full']


def test_what_systemd_has_no_room_for_is_told_again_in_its_order(manager: socket.socket) -> None:
    it = Systemd(manager.getsockname(), watchdog_s=60.0)
    fill(manager)
    it.ready('active')
    it.alive()
    it.status('active')
    assert heard(manager) == []
    for _ in range(3):
        it.tick()
        it.alive()
        it.status('active')
    assert heard(manager) == ['READY=1', 'WATCHDOG=1', 'STATUS=active']

    fill(manager)
    it.reloading()
    it.ready('active')
    assert heard(manager) == []
    it.tick()
    it.tick()
    assert heard(manager) == ['RELOADING=1', 'READY=1']


def test_a_stop_is_told_once_and_nothing_that_was_owed_comes_after_it(
    manager: socket.socket,
) -> None:
    it = Systemd(manager.getsockname())
    fill(manager)
    it.reloading()
    it.stopping()
    assert heard(manager) == []
    for _ in range(3):
        it.stopping()
        it.reloading()
        it.tick()
    assert heard(manager) == ['STOPPING=1']


def aged(age_s: float, state: State = State.RUNNING) -> Snapshot:
    """A snapshot whose thread was seen at work so long ago; 0 while it waits on purpose."""
    snapshot = Counters('orders', state=state).snapshot(0)
    return snapshot._replace(beat_s=time.monotonic() - age_s if age_s else 0.0)


@pytest.mark.parametrize(
    ('ages', 'live'),
    [
        ([], True),
        ([(0.1, State.RUNNING), (STUCK_S / 2, State.RUNNING)], True),
        ([(STUCK_S - 5, State.RUNNING)], True),
        ([(STUCK_S + 1, State.RUNNING)], False),
        ([(0.1, State.RUNNING), (STUCK_S + 1, State.RUNNING)], False),
        ([(STUCK_S + 1, State.STARTING)], False),
        ([(STUCK_S + 1, State.PAUSED)], False),
        ([(0.0, State.WAITING), (0.0, State.FAILED), (0.0, State.STOPPED)], True),
    ],
    ids=['none', 'young', 'just below', 'above', 'one of two', 'starting', 'paused', 'on purpose'],
)
def test_a_bridge_lives_as_long_as_no_route_is_stuck(
    ages: list[tuple[float, State]], *, live: bool
) -> None:
    assert is_live([aged(*age) for age in ages]) == live


def test_no_route_is_stuck_while_its_worker_starts_or_is_to_be_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    worker = handle('orders')
    hear(worker, to_line([aged(0.1)]))
    now_s = time.monotonic() + 2 * STUCK_S
    fresh = handle('new', number=2)
    monkeypatch.setattr('time.monotonic', lambda: now_s)
    assert is_live(fresh.snapshots.values())
    assert not is_live(worker.snapshots.values())
    worker.start_later('was ended by SIGKILL')
    assert is_live(worker.snapshots.values())


def test_a_worker_that_has_begun_and_tells_nothing_is_silent_and_one_that_starts_or_ends_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As one that stands still (SIGSTOP) with routes that wait on purpose: they need not beat."""
    worker = handle('orders')
    worker.process = cast('Any', SimpleNamespace(is_running=True))
    hear(worker, to_line([aged(0.0, State.WAITING)]))
    now_s = time.monotonic() + 40
    monkeypatch.setattr('time.monotonic', lambda: now_s)
    assert worker.silent_s == 0, 'it has not begun'
    worker._life.begun_s = now_s
    assert 40 <= worker.silent_s < 50
    worker._life.drain_orders = 1
    assert worker.silent_s == 0, 'it drains'


def test_what_a_worker_that_has_died_told_last_of_its_ends_is_not_known_any_more() -> None:
    worker = handle('orders')
    measures = Measures(kafka_up=True, matched=3, queued=7, spool_bytes=5, bytes_taken=9)
    snapshot = Counters('orders', taken=100).snapshot(100, 77, 0, measures)
    hear(worker, to_line([snapshot]))
    worker.start_later('was ended by SIGKILL')
    told = worker.snapshots['orders']
    assert (told.state, told.lag, told.taken, told.in_flight) == (State.FAILED, None, 100, 100)
    now = told.measures
    assert (now.kafka_up, now.matched, now.queued) == (None, None, None)
    assert (now.spool_bytes, now.bytes_taken) == (5, 9), 'what is on disk, and what was counted'


def test_what_runs_is_counted_in_the_words_for_systemd() -> None:
    def said(*states: State) -> str:
        return in_words(Lifecycle.ACTIVE, [aged(0.1, state) for state in states])

    assert said(State.RUNNING, State.WAITING, State.PAUSED) == 'active: 3 routes'
    assert said(State.RUNNING, State.FAILED, State.STARTING) == 'active: 1 of 3 routes'
