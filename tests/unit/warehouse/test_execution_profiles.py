"""The execution profiles as data: what an operator writes, and what he is told of mistakes."""

from pathlib import Path

import pytest

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.execution_profiles import (
    STEPS,
    ExecutionProfiles,
    Response,
    read_execution_profiles,
)
from ros2_kafka_warehouse.domain.profile_files import ProfileError
from ros2_kafka_warehouse.domain.robot_failure_profile import read_failure_profile

ONE_TYPE = """
robot_types:
  carrier: {max_load_kg: 30, sizes: [small]}
responses:
"""

BATTERY_ORDER = (
    'battery: must be 0 <= critical < low < target <= 100 (percent), '
    'is critical 10, low 25, target 101'
)


def _problems(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / 'profiles.yaml'
    path.write_text(text)
    with pytest.raises(ProfileError) as caught:
        read_execution_profiles(path)
    return [problem.removeprefix(f'{path}, ') for problem in caught.value.problems]


def test_the_shipped_profiles_have_the_two_types_of_robots() -> None:
    types = read_execution_profiles().robot_types

    assert types['carrier'].max_load_kg == 30
    assert types['carrier'].sizes == ('small', 'medium')
    assert types['carrier'].steps_per_cell == 1
    assert types['hauler'].max_load_kg == 120
    assert types['hauler'].sizes == ('small', 'medium', 'large')
    assert types['hauler'].steps_per_cell == 2


def test_each_failure_that_can_be_diagnosed_has_a_response_of_its_own() -> None:
    codes = {row.code for row in read_failure_profile().rows} | {'UNKNOWN'}

    assert codes <= set(read_execution_profiles().responses)


def test_every_step_of_a_response_has_words_for_a_person() -> None:
    responses = read_execution_profiles().responses.values()

    assert {step for response in responses for step in response.steps} <= set(STEPS)


def test_the_profiles_go_over_a_topic_and_are_the_same() -> None:
    profiles = read_execution_profiles()

    assert decode(encode(profiles), ExecutionProfiles) == profiles


def test_a_response_with_nothing_after_its_name_does_nothing(tmp_path: Path) -> None:
    path = tmp_path / 'profiles.yaml'
    path.write_text(ONE_TYPE + '  WARNING:\n')

    assert read_execution_profiles(path).responses == {'WARNING': Response('WARNING')}


def test_a_misspelt_field_is_told_with_line_and_what_was_meant(tmp_path: Path) -> None:
    text = 'robot_types:\n  carrier:\n    max_lod_kg: 30\n'

    assert _problems(tmp_path, text) == [
        'line 3: robot_types.carrier.max_lod_kg: unknown field; did you mean max_load_kg?'
    ]


def test_a_misspelt_field_of_the_battery_is_told(tmp_path: Path) -> None:
    text = 'robot_types:\n  carrier:\n    battery:\n      targt: 80\n'

    assert _problems(tmp_path, text) == [
        'line 4: robot_types.carrier.battery.targt: unknown field; did you mean target?'
    ]


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    text = 'robot_types:\n  carrier: {steps_per_cell: fast}\n  hauler: {sizes: large}\nother: 1\n'

    problems = _problems(tmp_path, text)

    assert len(problems) == 3
    assert problems[0].startswith('line 4: other: no such field; there are robot_types, responses')
    assert problems[1].startswith('line 2: robot_types.carrier.steps_per_cell: expected int')
    assert problems[2].startswith('line 3: robot_types.hauler.sizes: expected array')


def test_a_step_that_does_not_exist_is_told_with_what_was_meant(tmp_path: Path) -> None:
    text = ONE_TYPE + '  STALLED: {steps: [slow, waitt], wait_s: 3}\n'

    assert _problems(tmp_path, text) == [
        "line 5: responses.STALLED.steps[1]: no step 'waitt'; did you mean wait?"
    ]


def test_an_escalation_to_nowhere_is_told(tmp_path: Path) -> None:
    text = ONE_TYPE + '  STALLED: {escalate_to: MOTION}\n  MOTION_FAULT: {}\n'

    assert _problems(tmp_path, text) == [
        "line 5: responses.STALLED.escalate_to: no response 'MOTION'; did you mean MOTION_FAULT?"
    ]


def test_escalations_that_go_in_a_circle_are_told(tmp_path: Path) -> None:
    text = ONE_TYPE + '  A: {escalate_to: B}\n  B: {escalate_to: A}\n'

    assert [problem.partition(': ')[2] for problem in _problems(tmp_path, text)] == [
        'responses.A.escalate_to: leads back to itself',
        'responses.B.escalate_to: leads back to itself',
    ]


@pytest.mark.parametrize(
    ('fields', 'said'),
    [
        ('max_load_kg: 0', 'max_load_kg: must be more than 0'),
        ('steps_per_cell: 0', 'steps_per_cell: must be 1 or more'),
        ('pick_steps: -1', 'pick_steps: must be 0 or more'),
        ('sizes: []', 'sizes: must name a size of product at least'),
        ('battery: {charge_per_step: 0}', 'battery.charge_per_step: must be more than 0'),
        ('battery: {target: 101}', BATTERY_ORDER),
    ],
)
def test_a_type_that_cannot_be_is_refused(tmp_path: Path, fields: str, said: str) -> None:
    text = f'robot_types:\n  carrier:\n    {fields}\n'

    assert _problems(tmp_path, text) == [f'line 3: robot_types.carrier.{said}']


def test_retries_without_a_number_are_refused(tmp_path: Path) -> None:
    text = ONE_TYPE + '  PICK_FAILED: {steps: [retry]}\n'

    assert _problems(tmp_path, text) == [
        'line 5: responses.PICK_FAILED.retries: must be 1 or more with retry'
    ]


@pytest.mark.parametrize('text', ['', '- a\n', 'carrier\n'])
def test_a_file_that_holds_something_else_says_what_it_should_hold(
    tmp_path: Path, text: str
) -> None:
    assert _problems(tmp_path, text)[0] == 'line 1: must have the fields robot_types, responses'


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match=r'nowhere\.yaml: cannot be read: No such file'):
        read_execution_profiles(tmp_path / 'nowhere.yaml')


def test_a_file_that_is_not_yaml_is_told_with_its_line(tmp_path: Path) -> None:
    assert _problems(tmp_path, 'robot_types:\n  a: [1\n')[0].startswith('line 3: not YAML: ')


def test_a_number_without_end_is_refused(tmp_path: Path) -> None:
    assert _problems(tmp_path, ONE_TYPE.replace('30', '.nan')) == [
        'line 3: robot_types.carrier.max_load_kg: must be a finite number, is nan'
    ]
    assert _problems(tmp_path, ONE_TYPE + '  STALLED: {wait_s: .inf}\n') == [
        'line 5: responses.STALLED.wait_s: must be a finite number, is inf'
    ]


def test_a_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    text = 'robot_types:\n  1: {max_load_kg: 30}\n'

    assert _problems(tmp_path, text) == ["line 2: 1: a name must be text: put it in quotes ('1')"]


def test_names_in_quotes_and_merged_mappings_are_taken(tmp_path: Path) -> None:
    path = tmp_path / 'profiles.yaml'
    path.write_text(
        "robot_types:\n  '1': &one {max_load_kg: 30}\n  two: {<<: *one, steps_per_cell: 2}\n"
    )

    types = read_execution_profiles(path).robot_types
    assert (types['1'].max_load_kg, types['two'].max_load_kg) == (30, 30)


@pytest.mark.parametrize('text', ['x: &a [*a]\n', 'x: &a {y: [*a]}\n'])
def test_an_anchor_that_holds_itself_is_refused(tmp_path: Path, text: str) -> None:
    assert _problems(tmp_path, text) == [
        'line 1: the anchor holds itself: write out what is meant'
    ]


def test_a_file_that_is_nested_without_end_is_refused(tmp_path: Path) -> None:
    assert 'nested too deeply' in _problems(tmp_path, '[' * 5000)[0]
