"""What `check` says of a machine whose time of day cannot be right."""

import time
from pathlib import Path
from typing import cast
from unittest.mock import MagicMock

import pytest
from support.processes.terminal import typed

from ros2_kafka_bridge.commands.check import report
from ros2_kafka_bridge.commands.check.kafka import CheckedCluster
from ros2_kafka_bridge.commands.check.types import FoundType
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.kafka.overview import Overview
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.route import clock
from ros2_kafka_bridge.route.memory import Kept

FILE = """\
name: b
kafka: {bootstrap.servers: 'localhost:1'}
routes:
  - {name: orders, from: {kafka: orders}, format: text, \
to: {ros: /orders, type: std_msgs/msg/String}, max_age_s: 60}
  - {name: back, from: {ros: /orders}, to: {kafka: orders.returned}, format: text}
"""
AGELESS = FILE.replace(', max_age_s: 60', '')
SHOWS_1970 = "this machine's clock says 1970-01-01, and this version of the bridge was made after "
WAIT = f'  BAD  routes with max_age_s (orders) wait: {SHOWS_1970}'
LONG_PAST = (
    '  note records and dead letters are written with a time long past, and retention may delete '
    f'them at once: {SHOWS_1970}'
)


@pytest.fixture(autouse=True)
def _in_1970(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, 'time', lambda: 20.0)


def said(place: Path, text: str, *options: str) -> tuple[int, list[str]]:
    """The status, and what is said of the clock."""
    file = place / 'bridge.yaml'
    file.write_text(text)
    status, out, err = typed('check', file, *options)
    assert not err
    return status, [line for line in out.splitlines() if 'timedatectl' in line]


@pytest.mark.parametrize('options', [(), ('--connect',)])
@pytest.mark.parametrize(
    ('text', 'status', 'line'),
    [pytest.param(FILE, 1, WAIT, id='ages'), pytest.param(AGELESS, 0, LONG_PAST, id='ageless')],
)
def test_a_clock_that_cannot_be_right_is_named_with_the_cure(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    text: str,
    status: int,
    line: str,
    options: tuple[str, ...],
) -> None:
    monkeypatch.setattr(report, '_report_connected', lambda *_: 0)  # all else is well
    ended, [found] = said(tmp_path, text, *options)
    assert ended == status
    assert found.startswith(line)
    assert found.endswith(': set it (timedatectl, chronyc makestep)')


def test_nothing_is_said_of_a_clock_that_can_be_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, 'time', clock.RELEASED.timestamp)
    assert said(tmp_path, FILE) == (0, [])


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        (FILE, '0 routes would run; 1 would wait (orders: for the clock of this machine)'),
        (AGELESS, '1 route would run'),
    ],
)
def test_a_route_that_waits_for_the_clock_is_not_said_to_run(text: str, says: str) -> None:
    config = loads(text, 'bridge.yaml', {})
    node = MagicMock(spec=RosNode)
    node.subscribers.return_value = []
    kafka = CheckedCluster(cast('Overview', MagicMock(spec=Overview)), 'not asked', None, '')
    orders, _ = config.routes
    kept = {'orders': Kept(500, None)}
    met = report.Surroundings(config, cast('RosNode', node), kafka, '', kept)
    found = report._route_findings(orders, FoundType(), met)
    assert report.summary({'orders': found}) == says
