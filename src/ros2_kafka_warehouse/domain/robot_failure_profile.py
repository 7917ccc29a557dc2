"""Robot Failure Profile: the table from evidence to failure, cause, level and next step.

It is data: an operator adds a row and the Monitor knows one failure more. A row speaks of one
sign (a kind of evidence) and of conditions on its facts::

    - sign: error
      when: {error_type: [motionFault, 'wheel*'], carrying: true}
      code: MOTION_FAULT
      cause: effector
      level: FATAL
      next_step: look at its wheels, then repair and rejoin it

A condition is a value, a list of which one must fit, a pattern with `*`, or a comparison
(`'>= 3'`). The first row that fits counts. What no row fits is UNKNOWN.
"""

from fnmatch import fnmatchcase
from math import isfinite
from operator import ge, gt, le, lt
from pathlib import Path
from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.profile_files import ProfileFile, near_miss
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.robots import ActionStatus, ErrorLevel

DEFAULT_FILE: Final = Path(__file__).parent.parent / 'data' / 'robot_failure_profile.yaml'

Fact = str | float | bool

# What the Monitor can see, and the facts of each.
SIGNS: Final = {
    'silent': ('silent_s',),
    'restarted': ('absent_s',),
    'error': ('error_type', 'error_level', 'description', 'carrying'),
    'not_localized': ('carrying',),
    'jump': ('cells', 'carrying'),
    'off_plan': ('times', 'carrying'),
    'no_progress': ('steps', 'carrying'),
    'slow': ('factor', 'carrying'),
    'stuck': ('seconds', 'carrying'),
    'battery': ('band', 'state_of_charge', 'needed'),
    'action': ('action_type', 'status', 'result', 'carrying'),
    'overload': ('weight_kg', 'max_load_kg'),
    'safety': ('emergency_stop', 'field_violation', 'carrying'),
    'not_automatic': ('mode', 'carrying'),
    'not_charging': ('steps',),
    'task_blocked': ('reason', 'carried'),
    'fleet_silent': ('silent_s',),
}

# What each fact is: text of anybody's, true or false, a number, or one of these words.
KINDS: Final[dict[str, type | tuple[str, ...]]] = {
    'absent_s': float,
    'action_type': str,
    'band': ('low', 'critical', 'empty'),
    'carried': bool,
    'carrying': bool,
    'cells': float,
    'description': str,
    'emergency_stop': ('MANUAL', 'REMOTE', 'NONE'),
    'error_level': tuple(ErrorLevel),
    'error_type': str,
    'factor': float,
    'field_violation': bool,
    'max_load_kg': float,
    'mode': str,
    'needed': float,
    'reason': str,
    'result': str,
    'seconds': float,
    'silent_s': float,
    'state_of_charge': float,
    'status': tuple(ActionStatus),
    'steps': float,
    'times': float,
    'weight_kg': float,
}

_COMPARE: Final = {'>=': ge, '<=': le, '>': gt, '<': lt}


class Evidence(Message, frozen=True):
    """One thing that the Monitor has seen; `text` says it to a person."""

    sign: str
    text: str = ''
    facts: dict[str, Fact] = msgspec.field(default_factory=dict)


class FailureRow(Message, frozen=True):
    """A row of the table.

    Attributes:
        when: Conditions on the facts of the evidence; all must hold.
        cause: What failed: effector, sensor, control, power, communications, software, human,
            design, external (Carlson and Murphy, 2005), or unknown.
        next_step: What a person is to do.
    """

    code: str
    sign: str = ''
    when: dict[str, str | float | bool | tuple[str | float | bool, ...]] = msgspec.field(
        default_factory=dict
    )
    cause: str = 'unknown'
    level: ErrorLevel = ErrorLevel.CRITICAL
    next_step: str = ''


class Limits(Message, frozen=True):
    """From when on something counts as evidence.

    Attributes:
        silent_s: A robot that was not heard of for so long is silent.
        fleet_silent_s: The same for the fleet as a whole.
        blocked_steps: Steps in which it has an order to drive and does not begin.
        slow_factor: How many times the steps of its type it takes for a cell.
        even_moves: Moves at its normal speed after which it is no longer slow.
        stuck_s: A robot with a task that neither moves nor acts for so long is stuck.
        not_charging_steps: Steps on a charger, with the order to charge, without charging.
        jump_cells: A change of position by more than it can drive, and this.
        hold_s: How long a thing that happens in a moment counts as evidence.
        task_blocked_s: A task that is BLOCKED for so long is evidence.
        rejoin_s: How long an order to rejoin waits for a robot that still shows evidence.
    """

    silent_s: float = 2.0
    fleet_silent_s: float = 5.0
    blocked_steps: int = 3
    slow_factor: float = 2.0
    even_moves: int = 2
    stuck_s: float = 90.0
    not_charging_steps: int = 4
    jump_cells: float = 1.5
    hold_s: float = 3.0
    task_blocked_s: float = 5.0
    rejoin_s: float = 10.0


class RobotFailureProfile(Message, frozen=True):
    """`/robot_failure_profile`: the limits of evidence and the table."""

    limits: Limits = Limits()
    rows: tuple[FailureRow, ...] = ()


UNKNOWN: Final = FailureRow(
    'UNKNOWN', next_step='find out what it is and add a row to the robot failure profile'
)


def diagnose(evidence: Evidence, profile: RobotFailureProfile) -> FailureRow:
    """The first row of the table that fits; `UNKNOWN` if none does."""
    fitting = (row for row in profile.rows if row.sign == evidence.sign and _fits(row, evidence))
    return next(fitting, UNKNOWN)


def _fits(row: FailureRow, evidence: Evidence) -> bool:
    return all(
        name in evidence.facts and _holds(condition, evidence.facts[name])
        for name, condition in row.when.items()
    )


def _holds(condition: Fact | tuple[Fact, ...], fact: Fact) -> bool:
    if isinstance(condition, tuple):
        return any(_holds(one, fact) for one in condition)
    if isinstance(condition, bool) or isinstance(fact, bool):
        return condition is fact
    if not isinstance(condition, str):
        return condition == fact
    if isinstance(fact, str):
        return fnmatchcase(fact.lower(), condition.lower())
    sign, _, number = condition.strip().partition(' ')
    return sign in _COMPARE and bool(_COMPARE[sign](fact, float(number)))


def read_failure_profile(path: Path = DEFAULT_FILE) -> RobotFailureProfile:
    """The profile in a YAML file.

    Raises:
        ProfileError: Every mistake in it, with file, line, field and what would be right.
    """
    file = ProfileFile(path, ('limits', 'rows'))
    limits = file.message(Limits, 'limits')
    read = [(n, file.message(FailureRow, 'rows', n)) for n in range(file.count('rows'))]
    for field, value in msgspec.structs.asdict(limits or Limits()).items():
        if value <= 0:
            file.wrong('must be more than 0', 'limits', field)
    for number, row in read:
        if row is not None:
            _check_row(file, number, row)
    file.check()
    return RobotFailureProfile(limits or Limits(), tuple(row for _, row in read if row))


def _check_row(file: ProfileFile, number: int, row: FailureRow) -> None:
    facts = SIGNS.get(row.sign)
    if facts is None:
        text = f"no sign '{row.sign}'; {near_miss(row.sign, list(SIGNS))}"
        file.wrong(text, 'rows', number, 'sign')
        return
    if not row.code.strip():
        file.wrong('must name the failure', 'rows', number, 'code')
    for name, condition in row.when.items():
        if name not in facts:
            text = f'{row.sign} has no such fact; {near_miss(name, list(facts))}'
            file.wrong(text, 'rows', number, 'when', name)
            continue
        for one in condition if isinstance(condition, tuple) else (condition,):
            if text := _never_holds(one, KINDS[name]):
                file.wrong(text, 'rows', number, 'when', name)


def _never_holds(condition: Fact, kind: type | tuple[str, ...]) -> str:
    """Why a condition fits no fact of this kind, or nothing."""
    if kind is bool:
        right, what = isinstance(condition, bool), 'true or false'
    elif kind is float:
        is_number = isinstance(condition, (int, float)) and not isinstance(condition, bool)
        right = is_number or (isinstance(condition, str) and _is_comparison(condition))
        what = "a number, or like '>= 3'"
    else:
        right, what = isinstance(condition, str), 'text; put it in quotes'
    if not right:
        said = str(condition).lower() if isinstance(condition, bool) else repr(condition)
        return f'must be {what}, is {said}'
    if not isinstance(kind, tuple) or not isinstance(condition, str):
        return ''
    if any(fnmatchcase(word.lower(), condition.lower()) for word in kind):
        return ''
    return f"is never '{condition}'; {near_miss(condition, list(kind))}"


def _is_comparison(text: str) -> bool:
    sign, _, number = text.strip().partition(' ')
    try:
        return sign in _COMPARE and isfinite(float(number))
    except ValueError:
        return False
