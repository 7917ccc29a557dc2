"""What is said of something that a running bridge was asked for, and to whom."""

import logging
import selectors
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.process.crew import Crew
from ros2_kafka_bridge.process.operations import Operations
from ros2_kafka_bridge.process.plan import plan_of
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
def operations(file: Path) -> Iterator[Operations]:
    stop = Stop()
    crew = Crew([], selectors.DefaultSelector(), stop)
    made = Operations(plan_of(load(file, {}), file), crew, Lifecycle.UNCONFIGURED, stop)
    yield made
    made.close()
    made.release()
    crew.close()


def answer_to(operations: Operations, do: Do) -> Answer:
    answers: list[Answer] = []
    operations.request(Request(1, do), answers.append)
    while operations.busy:
        operations.step()
        time.sleep(0.02)
    (answer,) = answers
    return answer


@pytest.mark.parametrize('do', [Do.CONFIGURE, Do.RELOAD])
def test_each_mistake_of_a_file_is_an_error_in_a_line_of_its_own(
    operations: Operations, file: Path, caplog: pytest.LogCaptureFixture, do: Do
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    file.write_text(RIGHT.replace('text', 'x').replace('/a', 'a'))
    answer = answer_to(operations, do)
    *mistakes, end = answer.text.split('\n')
    assert len(mistakes) == 2
    assert end == 'refused: all goes on as it was'
    errors = [(logging.ERROR, f'{do}: {line}') for line in (*mistakes, end)]
    assert [(it.levelno, it.getMessage()) for it in caplog.records] == errors
    assert answer.said  # who has asked does not say it again


def test_what_was_done_is_said_in_one_line(
    operations: Operations, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    assert answer_to(operations, Do.CONFIGURE).done
    (line,) = caplog.records
    assert line.levelno == logging.INFO
    assert line.getMessage() == 'configure: configured: activate starts the routes'


def test_a_preview_is_for_whoever_asks_for_it(
    operations: Operations, file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    file.write_text('name: [')
    assert not answer_to(operations, Do.PREVIEW).said
    assert caplog.records == []
