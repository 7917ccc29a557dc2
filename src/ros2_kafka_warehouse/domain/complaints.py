"""What a robot says itself that is wrong with it: errors, safety, load, actions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ros2_kafka_warehouse.messages.robots import ActionState, ActionStatus, RobotState, SafetyState

if TYPE_CHECKING:
    from collections.abc import Container

    from ros2_kafka_warehouse.domain.execution_profiles import RobotType
    from ros2_kafka_warehouse.domain.signs import Signs

ALL_WELL: Final = SafetyState()
_ENDED: Final = (ActionStatus.FINISHED, ActionStatus.FAILED)


def show_complaints(state: RobotState, kind: RobotType | None, signs: Signs) -> None:
    """Bring the signs in line with the errors, the safety and the load that a state tells of."""
    carrying = bool(state.loads)
    _show_errors(state, signs, carrying=carrying)
    if state.position.localized:
        signs.clear('not_localized')
    elif 'not_localized' not in signs:
        text = 'says that it does not know where it is'
        signs.show('not_localized', 'not_localized', text, carrying=carrying)
    _show_safety(state, signs, carrying=carrying)
    show_overload(state, kind, signs)


def _show_errors(state: RobotState, signs: Signs, *, carrying: bool) -> None:
    shown = {f'error:{error.error_type}': error for error in state.errors}
    for key in [key for key in signs.evidence if key.startswith('error:')]:
        if key not in shown:
            signs.clear(key)
    for key, error in shown.items():
        if key not in signs:
            text = f'reports {error.error_type} ({error.error_level})'
            more = error.error_description
            signs.show(
                key,
                'error',
                f'{text}: {more}' if more else text,
                error_type=error.error_type,
                error_level=str(error.error_level),
                description=more,
                carrying=carrying,
            )


def _show_safety(state: RobotState, signs: Signs, *, carrying: bool) -> None:
    safety = state.safety_state
    stop = safety.active_emergency_stop
    if safety == ALL_WELL:
        signs.clear('safety')
    elif 'safety' not in signs:
        text = f'emergency stop: {stop}' if stop != 'NONE' else 'its protective field is violated'
        signs.show(
            'safety',
            'safety',
            text,
            emergency_stop=stop,
            field_violation=safety.field_violation,
            carrying=carrying,
        )
    mode = state.operating_mode
    if mode == 'AUTOMATIC':
        signs.clear('mode')
    elif 'mode' not in signs:
        text = f'its operating mode is {mode}'
        signs.show('mode', 'not_automatic', text, mode=mode, carrying=carrying)


def show_overload(state: RobotState, kind: RobotType | None, signs: Signs) -> None:
    """Whether it carries more than its type may."""
    weight_kg = sum(load.weight for load in state.loads)
    if kind is None or weight_kg <= kind.max_load_kg:
        signs.clear('overload')
    elif 'overload' not in signs:
        most_kg = kind.max_load_kg
        text = f'carries {weight_kg:g} kg, more than {most_kg:g} kg'
        signs.show('overload', 'overload', text, weight_kg=weight_kg, max_load_kg=most_kg)


def failed_actions(state: RobotState) -> frozenset[str]:
    """The actions that have failed, by id."""
    return frozenset(
        action.action_id
        for action in state.action_states
        if action.action_status is ActionStatus.FAILED
    )


def show_failed(
    state: RobotState, action_ids: Container[str], until_s: float, signs: Signs
) -> None:
    """Show the actions that have failed just now, until a time."""
    for action in state.action_states:
        if action.action_id in action_ids:
            _show_action(state, action, f'failed:{action.action_id}', signs, until_s)


def _show_action(
    state: RobotState, action: ActionState, key: str, signs: Signs, until_s: float | None = None
) -> None:
    result = action.result_description
    text = f'its {action.action_type} is {action.action_status}'
    signs.show(
        key,
        'action',
        f'{text}: {result}' if result else text,
        until_s,
        action_type=action.action_type,
        status=str(action.action_status),
        result=result,
        carrying=bool(state.loads),
    )


def show_retriable(state: RobotState, signs: Signs) -> None:
    """Actions that wait to be tried again; while they are, it is not known to be over."""
    by_id = {action.action_id: action for action in state.action_states}
    for key in [key for key in signs.evidence if key.startswith('retriable:')]:
        action = by_id.get(key.removeprefix('retriable:'))
        if action is None or action.action_status in _ENDED:
            signs.clear(key)
    for action in state.action_states:
        key = f'retriable:{action.action_id}'
        if action.action_status is ActionStatus.RETRIABLE and key not in signs:
            _show_action(state, action, key, signs)
