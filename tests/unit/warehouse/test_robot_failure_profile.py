"""The robot failure profile as data: from evidence to failure, and mistakes in the table."""

from pathlib import Path

import pytest

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.faults import CODES, symptom
from ros2_kafka_warehouse.domain.profile_files import ProfileError
from ros2_kafka_warehouse.domain.robot_failure_profile import (
    KINDS,
    SIGNS,
    Evidence,
    FailureRow,
    RobotFailureProfile,
    diagnose,
    read_failure_profile,
)
from ros2_kafka_warehouse.messages.robots import ErrorLevel

SHIPPED = read_failure_profile()


def _error(error_type: str, level: str = 'CRITICAL') -> Evidence:
    return Evidence('error', '', {'error_type': error_type, 'error_level': level})


def _problems(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / 'failures.yaml'
    path.write_text(text)
    with pytest.raises(ProfileError) as caught:
        read_failure_profile(path)
    return [problem.removeprefix(f'{path}, ') for problem in caught.value.problems]


@pytest.mark.parametrize('code', [code for code in CODES if symptom(code).error is not None])
def test_the_error_of_each_failure_is_diagnosed_as_that_failure(code: str) -> None:
    error = symptom(code).error
    assert error is not None

    assert diagnose(_error(error.error_type, str(error.error_level)), SHIPPED).code == code


@pytest.mark.parametrize(
    ('evidence', 'code'),
    [
        (Evidence('silent', '', {'silent_s': 2.0}), 'COMM_LOST'),
        (Evidence('restarted', '', {'absent_s': 2.0}), 'SOFTWARE_CRASH'),
        (Evidence('not_localized'), 'LOCALIZATION_ERROR'),
        (Evidence('jump', '', {'cells': 9.0}), 'LOCALIZATION_ERROR'),
        (Evidence('off_plan', '', {'times': 1.0}), 'OFF_PLAN'),
        (Evidence('no_progress', '', {'steps': 3}), 'PATH_BLOCKED'),
        (Evidence('slow', '', {'factor': 2.0}), 'DELAYED'),
        (Evidence('slow', '', {'factor': 6.0}), 'STALLED'),
        (Evidence('slow', '', {'factor': 20.0}), 'MOTION_FAULT'),
        (Evidence('battery', '', {'band': 'low'}), 'LOW_BATTERY'),
        (Evidence('battery', '', {'band': 'critical'}), 'BATTERY_CRITICAL'),
        (Evidence('battery', '', {'band': 'empty'}), 'BATTERY_DEPLETED'),
        (
            Evidence('action', '', {'action_type': 'pick', 'result': 'LOAD_MISSING'}),
            'LOAD_MISSING',
        ),
        (Evidence('action', '', {'action_type': 'pick', 'result': 'slipped'}), 'PICK_FAILED'),
        (
            Evidence('safety', '', {'emergency_stop': 'MANUAL', 'field_violation': True}),
            'EMERGENCY_STOP',
        ),
        (
            Evidence('safety', '', {'emergency_stop': 'NONE', 'field_violation': True}),
            'FIELD_VIOLATION',
        ),
        (Evidence('not_charging', '', {'steps': 4.0}), 'CHARGER_FAULT'),
        (_error('VALIDATION_FAILURE', 'WARNING'), 'ORDER_REJECTED'),
        (_error('OTHER_ORDER_ACTIVE', 'WARNING'), 'ORDER_REJECTED'),
    ],
)
def test_what_is_seen_is_diagnosed(evidence: Evidence, code: str) -> None:
    assert diagnose(evidence, SHIPPED).code == code


def test_an_error_that_nobody_knows_is_unknown_and_critical() -> None:
    row = diagnose(_error('gearboxSings'), SHIPPED)

    assert (row.code, row.level) == ('UNKNOWN', ErrorLevel.CRITICAL)


def test_a_warning_that_nobody_knows_stops_no_robot() -> None:
    assert diagnose(_error('lampDusty', 'WARNING'), SHIPPED).code == 'WARNING'


def test_a_new_row_of_an_operator_knows_one_failure_more(tmp_path: Path) -> None:
    path = tmp_path / 'failures.yaml'
    path.write_text(
        'rows:\n'
        '  - sign: error\n'
        "    when: {error_type: 'gearbox*', carrying: true}\n"
        '    code: MOTION_FAULT\n'
        '    level: FATAL\n'
    )
    profile = read_failure_profile(path)
    facts = {'error_type': 'gearboxSings', 'error_level': 'CRITICAL'}

    assert diagnose(Evidence('error', '', {**facts, 'carrying': True}), profile).code == (
        'MOTION_FAULT'
    )
    assert diagnose(Evidence('error', '', {**facts, 'carrying': False}), profile).code == 'UNKNOWN'


def test_the_first_row_that_fits_counts() -> None:
    rows = (
        FailureRow('NARROW', 'slow', {'factor': '>= 4'}),
        FailureRow('WIDE', 'slow'),
        FailureRow('NEVER', 'slow'),
    )
    profile = RobotFailureProfile(rows=rows)

    assert diagnose(Evidence('slow', '', {'factor': 4.0}), profile).code == 'NARROW'
    assert diagnose(Evidence('slow', '', {'factor': 3.9}), profile).code == 'WIDE'


def test_a_condition_on_a_fact_that_is_not_there_does_not_hold() -> None:
    profile = RobotFailureProfile(rows=(FailureRow('A', 'slow', {'factor': '< 9'}),))

    assert diagnose(Evidence('slow'), profile).code == 'UNKNOWN'


def test_the_profile_goes_over_a_topic_and_is_the_same() -> None:
    assert decode(encode(SHIPPED), RobotFailureProfile) == SHIPPED


def test_each_row_of_the_shipped_table_tells_a_person_what_to_do() -> None:
    assert [row.code for row in SHIPPED.rows if not row.next_step] == []
    assert {row.sign for row in SHIPPED.rows} == set(SIGNS)


@pytest.mark.parametrize(
    ('row', 'said'),
    [
        ('{sign: slwo, code: A}', "rows[0].sign: no sign 'slwo'; did you mean slow?"),
        ('{sign: slow, cod: A}', 'rows[0].cod: unknown field; did you mean code?'),
        ('{sign: slow}', "rows[0]: the field 'code' is missing"),
        (
            '{sign: slow, code: A, when: {fctor: 3}}',
            'rows[0].when.fctor: slow has no such fact; did you mean factor?',
        ),
        (
            "{sign: slow, code: A, when: {factor: '>3'}}",
            "rows[0].when.factor: must be a number, or like '>= 3', is '>3'",
        ),
        (
            '{sign: slow, code: A, when: {factor: banana}}',
            "rows[0].when.factor: must be a number, or like '>= 3', is 'banana'",
        ),
        (
            '{sign: battery, code: A, when: {band: emty}}',
            "rows[0].when.band: is never 'emty'; did you mean empty?",
        ),
        (
            '{sign: action, code: A, when: {status: [FAILED, BROKEN]}}',
            "rows[0].when.status: is never 'BROKEN'; there are WAITING,",
        ),
        (
            '{sign: error, code: A, when: {error_type: 404}}',
            'rows[0].when.error_type: must be text; put it in quotes, is 404',
        ),
        (
            "{sign: slow, code: A, when: {carrying: 'yes'}}",
            "rows[0].when.carrying: must be true or false, is 'yes'",
        ),
        ("{sign: slow, code: ''}", 'rows[0].code: must name the failure'),
    ],
)
def test_a_mistake_in_a_row_is_told_with_its_line(tmp_path: Path, row: str, said: str) -> None:
    problems = _problems(tmp_path, f'rows:\n  - {row}\n')
    assert any(problem.startswith(f'line 2: {said}') for problem in problems)


def test_a_pattern_that_a_word_fits_is_taken(tmp_path: Path) -> None:
    path = tmp_path / 'failures.yaml'
    path.write_text("rows:\n  - {sign: battery, code: A, when: {band: 'Crit*'}}\n")
    assert (
        diagnose(Evidence('battery', '', {'band': 'critical'}), read_failure_profile(path)).code
        == 'A'
    )


def test_every_fact_that_can_be_seen_has_a_kind() -> None:
    named = {name for facts in SIGNS.values() for name in facts}
    assert named == set(KINDS)


@pytest.mark.parametrize('number', ['.nan', '.inf', '1e999'])
def test_a_limit_without_end_is_refused(tmp_path: Path, number: str) -> None:
    [problem] = _problems(tmp_path, f'limits:\n  silent_s: {number}\n')
    assert problem.startswith('line 2: limits.silent_s: must be a finite number, is ')


def test_a_level_that_does_not_exist_is_told(tmp_path: Path) -> None:
    problems = _problems(tmp_path, 'rows:\n  - sign: slow\n    code: A\n    level: BAD\n')

    assert problems[0].startswith('line 4: rows[0].level: ')


def test_a_limit_of_nothing_is_refused(tmp_path: Path) -> None:
    assert _problems(tmp_path, 'limits:\n  silent_s: 0\n') == [
        'line 2: limits.silent_s: must be more than 0'
    ]


def test_rows_that_are_no_list_are_told(tmp_path: Path) -> None:
    assert _problems(tmp_path, 'rows:\n  slow: MOTION_FAULT\n') == [
        "line 1: rows: must be a list of rows, each with a '-'"
    ]
