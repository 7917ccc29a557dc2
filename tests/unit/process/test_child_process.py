"""A child process is told lines and tells lines, and never holds up whoever has started it."""

import errno
import os
import selectors
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from support.processes.harness import eventually

from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.lines import LineReader, LineWriter

Program = Callable[[str], None]


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Program:
    """Lets every child be such a program; `say` tells a line."""
    python = sys.executable

    def write(text: str) -> None:
        file = tmp_path / 'program'
        file.write_text(
            f'#!{python}\n'
            'import os, sys, time\n'
            'pipe = next(int(w[8:]) for w in sys.argv if w.startswith("--tells="))\n'
            'def say(line): os.write(pipe, line.encode() + b"\\n")\n'
            f'{text}'
        )
        file.chmod(0o700)
        monkeypatch.setattr('sys.executable', str(file))

    return write


@pytest.fixture
def child() -> Iterator[ChildProcess]:
    with selectors.DefaultSelector() as selector:
        made = ChildProcess('some.module', 'tells', selector)
        yield made
        made.kill()
        made.close()


def lines_of(child: ChildProcess, many: int) -> list[bytes]:
    """The next lines that it tells."""
    found: list[bytes] = []

    def has_told() -> bool:
        found.extend(child.exchange())
        return len(found) >= many

    eventually(has_told, 60)
    return found


def status_of(child: ChildProcess) -> int | None:
    statuses: list[int] = []

    def has_ended() -> bool:
        status = child.exit_status()
        statuses.extend([] if status is None else [status])
        return bool(statuses)

    eventually(has_ended, 60)
    return statuses[0]


def test_what_a_child_is_told_arrives_and_what_it_tells_comes_back(
    child: ChildProcess, program: Program
) -> None:
    program('for line in sys.stdin: say("heard " + line.strip())\n')
    child.send(b'to nobody\n')
    child.start([], [])
    child.send(b'one\n')
    child.send(b'two\n')
    assert lines_of(child, 2) == [b'heard one', b'heard two']
    child.close_input()
    assert status_of(child) == 0
    assert not child.is_running
    assert child.exit_status() is None, 'that was told once'


def test_what_a_child_tells_last_is_known_after_its_end(
    child: ChildProcess, program: Program
) -> None:
    program('say("last words")\nos._exit(3)\n')
    child.start([], [])
    assert status_of(child) == 3
    assert child.exchange() == [b'last words']


def test_a_child_that_reads_nothing_holds_nobody_up_and_is_known_to_be_stuck(
    child: ChildProcess, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    program('say("up")\ntime.sleep(600)\n')
    child.start([], [])
    lines_of(child, 1)
    now_s = [100.0]
    monkeypatch.setattr('time.monotonic', lambda: now_s[0])
    for _ in range(5):
        child.send(b'x' * 60_000 + b'\n')
        now_s[0] += 10
    assert child.unsent_bytes > 200_000
    assert 30 <= child.stuck_s <= 50
    child.kill()
    assert status_of(child) == -9
    assert child.unsent_bytes == 0
    assert child.stuck_s == 0


def test_a_next_life_hears_nothing_that_the_one_before_was_told(
    child: ChildProcess, program: Program
) -> None:
    program('say("up")\ntime.sleep(600)\n')
    child.start([], [])
    lines_of(child, 1)
    child.send(b'x' * 200_000 + b'\n')
    child.kill()
    status_of(child)
    program('for line in sys.stdin: say(line.strip())\n')
    child.start([], [])
    child.send(b'fresh\n')
    assert lines_of(child, 1) == [b'fresh']


def no_room(*_: object) -> NoReturn:
    raise OSError(errno.ENOSPC, 'No space left on device')


@pytest.mark.parametrize('why', ['no such program', 'no room to wait for it'])
def test_a_child_that_could_not_be_started_leaves_no_file_open(
    child: ChildProcess, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    monkeypatch.setattr('sys.executable', '/nowhere/python')
    if why == 'no room to wait for it':
        monkeypatch.setattr('selectors.DefaultSelector.register', no_room)
    before = len(list(Path('/proc/self/fd').iterdir()))
    for _ in range(3):
        with pytest.raises(OSError, match=r'No (such file|space left)'):
            child.start([], [])
    assert len(list(Path('/proc/self/fd').iterdir())) == before
    assert not child.is_running
    assert child.exchange() == []


def test_who_reads_no_more_is_told_nothing_and_nothing_waits_for_it() -> None:
    pipe, its_end = os.pipe()
    writer = LineWriter(its_end)
    os.close(pipe)
    writer.send(b'to nobody\n')
    assert writer.unsent == b''
    os.close(its_end)


def test_a_line_that_is_too_long_is_left_out_and_the_next_one_is_read() -> None:
    pipe, its_end = os.pipe()
    reader = LineReader(pipe, limit_bytes=100)
    os.write(its_end, b'x' * 150)
    assert reader.read() == []
    os.write(its_end, b'x\nwhole\n')
    assert reader.read()[-1] == b'whole'
    os.close(its_end)
    assert reader.read() == []
    assert reader.has_ended
    os.close(pipe)
