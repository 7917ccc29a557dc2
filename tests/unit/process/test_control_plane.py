"""What is said of something that a running bridge was asked for, and to whom."""

import errno
import logging
import selectors
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.process.control_plane import ControlPlane
from ros2_kafka_bridge.process.plan import plan_of
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.protocol.monitor import Answer, Do, Lifecycle, Request
from ros2_kafka_bridge.threads.stop import Stop

RIGHT = """\
name: test
kafka: {bootstrap.servers: x}
routes:
  - {name: a, from: {kafka: a}, to: {ros: /a, type: std_msgs/msg/String}, format: text}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    made = tmp_path / 'bridge.yaml'
    made.write_text(RIGHT)
    return made


@pytest.fixture
def control(file: Path) -> Iterator[ControlPlane]:
    stop = Stop()
    with selectors.DefaultSelector() as selector:
        pool = WorkerPool(plan_of(load(file, {}), file), [], selector, stop)
        made = ControlPlane(pool, Lifecycle.UNCONFIGURED, stop)
        yield made
        made.close()
        pool.close()


def answer_to(control: ControlPlane, do: Do) -> Answer:
    answers: list[Answer] = []
    control.handle(Request(1, do), answers.append)
    while control.is_busy:
        control.step()
        time.sleep(0.02)
    (answer,) = answers
    return answer


@pytest.mark.parametrize('do', [Do.CONFIGURE, Do.RELOAD])
def test_each_mistake_of_a_file_is_an_error_in_a_line_of_its_own(
    control: ControlPlane, file: Path, caplog: pytest.LogCaptureFixture, do: Do
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    file.write_text(RIGHT.replace('text', 'x').replace('/a', 'a'))
    answer = answer_to(control, do)
    *mistakes, end = answer.text.split('\n')
    assert len(mistakes) == 2
    assert end == 'refused: all goes on as it was'
    errors = [(logging.ERROR, f'{do}: {line}') for line in (*mistakes, end)]
    assert [(it.levelno, it.getMessage()) for it in caplog.records] == errors
    assert answer.said  # who has asked does not say it again


def test_what_was_done_is_said_in_one_line(
    control: ControlPlane, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    assert answer_to(control, Do.CONFIGURE).done
    (line,) = caplog.records
    assert line.levelno == logging.INFO
    assert line.getMessage() == 'configure: configured: activate starts the routes'


def test_a_preview_is_for_whoever_asks_for_it(
    control: ControlPlane, file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    file.write_text('name: [')
    assert not answer_to(control, Do.PREVIEW).said
    assert caplog.records == []


@pytest.mark.parametrize('do', [Do.PREVIEW, Do.RELOAD])
def test_a_reload_without_room_for_a_process_says_what_is_missing(
    control: ControlPlane, do: Do, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(*_: object, **__: object) -> NoReturn:
        raise OSError(errno.EMFILE, 'Too many open files')

    monkeypatch.setattr('subprocess.Popen', no_room)
    answer = answer_to(control, do)
    assert not answer.done
    assert answer.text == 'Too many open files: refused: all goes on as it was'
