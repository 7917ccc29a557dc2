"""Whether packages of message types are imported: by the middleware, its versions, a trial."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
from support.formats.messages import new_message

from ros2_kafka_bridge.ros import take
from ros2_kafka_bridge.ros.type_support import choice, self_test
from ros2_kafka_bridge.ros.type_support.choice import (
    TRIED,
    Versions,
    installed_versions,
    why_import,
)
from ros2_kafka_bridge.ros.type_support.self_test import self_test_problem
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.threads.stop import Stop

STRING = 'std_msgs/msg/String'
UNTRIED = Versions('99.1.0', '', '99.0.0', '99.0.0', '5.0.0', '4.0.0', '5.0.0')


@pytest.fixture(autouse=True)
def chosen_anew() -> Iterator[None]:
    choice._known.clear()
    yield
    choice._known.clear()


def imports(name: str) -> bool:
    return load_type(name).endpoint_class is type(new_message(name))


def test_the_ros_of_the_tests_was_tried() -> None:
    assert installed_versions() in TRIED
    assert why_import() == ''
    assert not imports(STRING)


def test_whoever_says_so_gets_the_packages() -> None:
    assert load_type(STRING, 'import').endpoint_class is type(new_message(STRING))


@pytest.mark.parametrize(
    'name', ['rmw_cyclonedds_cpp', 'rmw_zenoh_cpp', 'rmw_fastrtps_dynamic_cpp']
)
def test_another_middleware_needs_the_packages(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(choice, 'middleware', lambda: name)
    assert why_import() == f'{name} needs them'
    assert imports(STRING)


def test_profiles_that_reserve_memory_need_the_sizes_of_the_packages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv('RMW_FASTRTPS_USE_QOS_FROM_XML', '1')
    assert why_import().startswith('RMW_FASTRTPS_USE_QOS_FROM_XML=1 lets profiles reserve memory')
    assert imports(STRING)


def test_versions_that_nobody_has_tried_are_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def counted(stop: Stop) -> str:
        tried.append(self_test_problem(stop))
        return tried[-1]

    monkeypatch.setattr(choice, 'installed_versions', lambda: UNTRIED)
    monkeypatch.setattr(choice, 'self_test_problem', counted)
    assert [why_import(), why_import()] == ['', '']
    assert tried == ['']
    assert not imports(STRING)


@pytest.mark.parametrize(
    ('does', 'said'),
    [
        ('kill -SEGV $$', 'types without them were tried, and failed: ended by signal 11 (Segm'),
        ('echo a; echo b is c >&2; exit 1', 'types without them were tried, and failed: b is c'),
        (
            'echo $ROS_AUTOMATIC_DISCOVERY_RANGE $ROS_DOMAIN_ID $ROS_SECURITY_ENABLE; exit 1',
            'types without them were tried, and failed: OFF 0 false',
        ),
        ('exit 3', 'types without them were tried, and failed: exit status 3'),
        (
            'exec sleep 60',
            'types without them were tried, and failed: that had not ended after 1 s',
        ),
        ('echo b is c; echo; exit 1', 'types without them were tried, and failed: b is c'),
    ],
)
def test_a_trial_that_fails_is_one_line_and_the_packages_are_imported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, does: str, said: str
) -> None:
    program = tmp_path / 'python'
    program.write_text(f'#!/bin/sh\n{does}\n')
    program.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(program))
    monkeypatch.setattr(self_test, '_PATIENCE_S', 1.0)
    monkeypatch.setattr(choice, 'installed_versions', lambda: UNTRIED)
    assert why_import().startswith(said)
    assert '\n' not in why_import()
    assert imports(STRING)


@pytest.mark.parametrize(
    ('came', 'said'),
    [
        (b'\0\1\0\0\0\1\2\3\4\5\6\7', ''),
        (b'\0\1\0\0\0\1\2\3\4\5\6\6', ', which was published, 000100000001020304050606 came'),
        (None, ', which was published, nothing came'),
    ],
)
def test_a_message_that_comes_otherwise_is_no_passed_self_test(
    monkeypatch: pytest.MonkeyPatch, came: bytes | None, said: str
) -> None:
    taken: list[Any] = [] if came is None else [(came, {})]
    monkeypatch.setattr(take, 'take', lambda *_: (taken, True))
    monkeypatch.setattr(take, 'MatchEvents', MagicMock())
    monkeypatch.setattr(self_test, '_ANSWER_S', 0.1)
    node = MagicMock()
    node.get_publishers_info_by_topic.return_value = [MagicMock(topic_type=self_test._TYPE)]
    assert self_test._carry(node).endswith(said)
    assert bool(self_test._carry(node)) is bool(said)


def test_a_publisher_of_another_type_is_no_passed_self_test(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(take, 'take', lambda *_: ([(self_test._MESSAGE, {})], True))
    monkeypatch.setattr(take, 'MatchEvents', MagicMock())
    node = MagicMock()
    node.get_publishers_info_by_topic.return_value = [MagicMock(topic_type='x/msg/Y')]
    assert self_test._carry(node).startswith("the graph shows ['x/msg/Y'] of a publisher of ")


def test_a_stop_ends_a_self_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / 'python'
    program.write_text('#!/bin/sh\nexec sleep 60\n')
    program.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(program))
    stop = Stop()
    stop.ask()
    assert self_test_problem(stop).startswith('a stop came before it was known')


def test_a_program_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, 'executable', '/nowhere/python')
    assert self_test_problem(Stop()).startswith(
        'types without them could not be tried: [Errno 2] No such file'
    )


def test_types_that_tell_something_else_are_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, 'difference', lambda: 'x is 1, expected was 2')
    assert why_import() == 'x is 1, expected was 2'
    assert imports(STRING)


def test_a_trial_is_not_hindered_by_what_the_user_has_set(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    profile = tmp_path / 'profile.xml'
    profile.write_text('<not a profile')
    monkeypatch.setenv('FASTDDS_DEFAULT_PROFILES_FILE', str(profile))
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', 'nowhere:1')
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    assert self_test_problem(Stop()) == ''
