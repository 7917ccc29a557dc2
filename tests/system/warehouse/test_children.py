"""Processes that are kept running."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest
from support.processes.harness import eventually

from ros2_kafka_warehouse import children
from ros2_kafka_warehouse.children import Child, Program


def _child(code: str, place: Path, again_s: float = 60.0) -> Child:
    program = Program('part', (sys.executable, '-S', '-c', code), 'works')
    return Child(program, place, again_s=again_s)


@pytest.fixture
def _waits_are_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, '_SHORTEST_S', 0.05)


def _look(child: Child, said: list[str]) -> bool:
    said.append(child.look())
    return False


def _is_started_again(child: Child) -> None:
    """As one that was silent for too long."""
    first, said = child.pid, list[str]()
    eventually(lambda: _look(child, said) or (child.runs and child.pid != first), 20)
    assert any('part has been silent for' in news for news in said)
    child.kill()


def test_a_process_that_dies_is_started_again(tmp_path: Path) -> None:
    child = _child('print("works", flush=True); import time; time.sleep(60)', tmp_path)
    child.start()
    eventually(lambda: child.is_ready, 10)
    first = child.pid
    child.kill()
    said: list[str] = []
    eventually(lambda: _look(child, said) or child.is_ready, 10)
    assert child.pid != first
    assert any('was ended by SIGKILL: is started again in 0.5 s' in news for news in said)
    child.ask_to_end()
    assert child.end(time.monotonic() + 10)


@pytest.mark.usefixtures('_waits_are_short')
def test_a_process_in_a_crash_loop_is_out_of_service_and_its_last_words_are_shown(
    tmp_path: Path,
) -> None:
    child = _child('raise SystemExit("the map is gone")', tmp_path)
    child.start()
    said: list[str] = []
    eventually(lambda: _look(child, said) or child.out_of_service, 30)
    story = ', 5 times in a row: OUT OF SERVICE, is tried again in 60 s\n    the map is gone'
    assert story in '\n'.join(said)
    assert not child.runs


@pytest.mark.usefixtures('_waits_are_short')
def test_a_process_out_of_service_is_tried_again_and_said_each_time(tmp_path: Path) -> None:
    child = _child('raise SystemExit("the map is gone")', tmp_path, again_s=0.1)
    child.start()
    said: list[str] = []
    eventually(lambda: _look(child, said) or ', 7 times in a row' in '\n'.join(said), 30)
    lines = [line for news in said for line in news.splitlines() if 'OUT OF SERVICE' in line]
    assert len(lines) == 3
    assert child.out_of_service


def test_a_process_that_does_not_end_is_killed(tmp_path: Path) -> None:
    ignores = 'import signal, time; signal.signal(15, signal.SIG_IGN); print("works", flush=True)'
    child = _child(f'{ignores}; time.sleep(60)', tmp_path)
    child.start()
    eventually(lambda: child.is_ready, 10)
    child.ask_to_end()
    assert not child.end(time.monotonic() + 0.2)
    assert not child.runs


def test_a_process_that_hangs_is_ended_and_started_again(tmp_path: Path) -> None:
    alive = tmp_path / 'alive'
    code = 'import pathlib, sys, time; pathlib.Path(sys.argv[1]).touch(); time.sleep(60)'
    command = (sys.executable, '-S', '-c', code, str(alive))
    child = Child(Program('part', command, 'works', alive), tmp_path, hung_s=1.0)
    child.start()
    _is_started_again(child)


def test_a_process_that_hangs_before_it_is_alive_is_ended_and_started_again(
    tmp_path: Path,
) -> None:
    command = (sys.executable, '-S', '-c', 'import time; time.sleep(60)')
    program = Program('part', command, 'works', tmp_path / 'alive')
    child = Child(program, tmp_path, hung_s=0.3)
    child.start()
    _is_started_again(child)


def test_a_clock_that_is_set_while_a_process_works_ends_it_not(tmp_path: Path) -> None:
    alive = tmp_path / 'alive'
    code = """
import os, sys, time
for touched in range(600):
    open(sys.argv[1], 'a').close()
    os.utime(sys.argv[1], (touched, touched))  # as the clock was in 1970
    time.sleep(0.1)
"""
    command = (sys.executable, '-S', '-c', code, str(alive))
    child = Child(Program('part', command, 'works', alive), tmp_path)
    child.start()
    first = child.pid
    said: list[str] = []
    eventually(alive.exists, 20)
    until_s = time.monotonic() + 1.0
    eventually(lambda: _look(child, said) or time.monotonic() > until_s, 20)
    assert child.pid == first, said
    child.kill()


SERVICE = """
import os, socket, time
end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
address = '\\0' + os.environ['NOTIFY_SOCKET'][1:]
assert 0 < int(os.environ['WATCHDOG_USEC']) <= 1_000_000
while True:
    end.sendto(b'WATCHDOG=1', address)
    time.sleep(0.1)
"""


def test_a_service_that_tells_no_longer_that_it_works_is_started_again(tmp_path: Path) -> None:
    command = (sys.executable, '-S', '-c', SERVICE)
    program = Program('part', command, 'works', tmp_path / 'alive', tells_as_service=True)
    child = Child(program, tmp_path, hung_s=1.0)
    child.start()
    first = child.pid
    said: list[str] = []
    until_s = time.monotonic() + 4.0
    eventually(lambda: _look(child, said) or time.monotonic() > until_s, 20)
    assert child.pid == first, said
    os.kill(first, signal.SIGSTOP)
    _is_started_again(child)
