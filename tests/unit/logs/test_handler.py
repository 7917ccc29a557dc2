"""A log that is read, one that nobody reads, and one whose reader has gone."""

import fcntl
import logging
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest
from support.patience import eventually

from ros2_kafka_bridge.logs import handler as module
from ros2_kafka_bridge.logs.handler import LogHandler

_ROOM_BYTES: Final = 4096


class Pipe:
    """A small pipe, and a log that goes there; lines are written as they are given."""

    def __init__(self, most_bytes: int = 1000) -> None:
        self.read_end, self.write_end = os.pipe()
        fcntl.fcntl(self.write_end, fcntl.F_SETPIPE_SZ, _ROOM_BYTES)
        self.handler = LogHandler(self.write_end, most_bytes)

    def fill(self) -> None:
        """Leave no room in it."""
        os.write(self.write_end, b'x' * (_ROOM_BYTES - 1) + b'\n')

    def say(self, *texts: str) -> None:
        for text in texts:
            record = logging.LogRecord('ros2_kafka_bridge', 20, '', 0, text, None, None)
            self.handler.handle(record)

    def read_until(self, condition: Callable[[str], bool]) -> list[str]:
        os.set_blocking(self.read_end, False)
        got = b''

        def found() -> bool:
            nonlocal got
            try:
                got += os.read(self.read_end, 65_536)
            except BlockingIOError:
                return False
            return condition(got.decode())

        eventually(found, 30)
        return got.decode().splitlines()


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    it = Pipe()
    yield it
    os.set_blocking(it.write_end, False)
    it.handler.flush()
    os.close(it.read_end)
    os.close(it.write_end)


@pytest.fixture
def _no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, '_PATIENCE_S', 0.01)
    monkeypatch.setattr(module, '_LAST_S', 0.05)


def test_what_is_said_is_out_when_the_call_returns(
    pipe: Pipe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, '_PATIENCE_S', 30.0)
    os.set_blocking(pipe.read_end, False)
    for number in range(100):
        pipe.say(f'line {number}')
        assert os.read(pipe.read_end, 100) == b'line %d\n' % number


@pytest.mark.usefixtures('_no_patience')
def test_a_log_that_nobody_reads_holds_nobody_up_and_is_told_later(pipe: Pipe) -> None:
    pipe.fill()
    said = [f'line {number}' for number in range(500)]
    thread = threading.Thread(target=pipe.say, args=said, daemon=True)
    thread.start()
    thread.join(30)
    assert not thread.is_alive(), 'who logs waits for nobody'
    pipe.handler.flush()  # nor does the end of the process
    _, *lines, note = pipe.read_until(lambda text: text.endswith('written\n'))
    assert lines == said[: len(lines)], 'the first ones, in their order'
    left_out = 500 - len(lines)
    assert note == f'{left_out} lines of this log left out here: it could not be written'
    pipe.say('read again')
    assert pipe.read_until(lambda text: text.endswith('\n')) == ['read again']


def test_what_a_full_disk_did_not_take_is_counted(tmp_path: Path) -> None:
    descriptor = os.open('/dev/full', os.O_WRONLY)
    pipe = Pipe()
    handler, pipe.handler = pipe.handler, LogHandler(descriptor)
    pipe.say(*(f'line {number}' for number in range(10)))
    with (tmp_path / 'log').open('wb') as room:
        os.dup2(room.fileno(), descriptor)
    pipe.say('room again')
    assert (tmp_path / 'log').read_text().splitlines() == [
        '10 lines of this log left out here: it could not be written',
        'room again',
    ]
    handler.flush()
    for one in (descriptor, pipe.read_end, pipe.write_end):
        os.close(one)


@pytest.mark.usefixtures('_no_patience')
def test_a_line_longer_than_the_room_is_said_where_nothing_waits(pipe: Pipe) -> None:
    pipe.say('y' * 3000)
    assert pipe.read_until(lambda text: text.endswith('\n')) == ['y' * 3000]


@pytest.mark.usefixtures('_no_patience')
def test_a_log_that_somebody_else_has_made_non_blocking_loses_nothing(pipe: Pipe) -> None:
    os.set_blocking(pipe.write_end, False)
    pipe.fill()
    pipe.say('late')
    assert pipe.read_until(lambda text: text.endswith('late\n'))[-1] == 'late'


def test_a_log_whose_reader_has_gone_is_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    pipe = Pipe()
    os.close(pipe.read_end)
    pipe.say('one', 'two')
    pipe.handler.flush()
    os.close(pipe.write_end)
    assert capfd.readouterr().err == ''
