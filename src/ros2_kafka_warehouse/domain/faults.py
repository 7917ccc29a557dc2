"""What can go wrong with a simulated robot, and what of it the robot shows.

What it shows is evidence only; which failure that is, the Monitor has to find out.
"""

from collections.abc import Iterable
from random import Random
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.profile_files import near_miss
from ros2_kafka_warehouse.messages.robots import Error, ErrorLevel

CRASH_STEPS: Final = 10  # that a robot's software needs to start again
REFUSALS: Final = 2  # orders in a row that a robot with ORDER_REJECTED refuses


class FaultError(ValueError):
    """A fault that cannot be: says what is wrong, and what would be right."""


class Symptom(NamedTuple):
    """What a robot with a fault says, and whether it still drives."""

    error: Error | None = None
    stands: bool = False


def _says(error_type: str, level: ErrorLevel, text: str, hint: str = '') -> Symptom:
    return Symptom(Error(error_type, level, text, hint), stands=True)


_SYMPTOMS: Final = {
    'PATH_BLOCKED': Symptom(),
    'NODE_UNREACHABLE': _says('NODE_UNREACHABLE', ErrorLevel.CRITICAL, 'finds no way on'),
    'STALLED': Symptom(),
    'DELAYED': Symptom(),
    'MOTION_FAULT': _says('motionFault', ErrorLevel.FATAL, 'a wheel does not turn'),
    'LOCALIZATION_ERROR': _says(
        'LOCALIZATION_ERROR', ErrorLevel.FATAL, 'does not know where it is', 'set its pose'
    ),
    'LOW_BATTERY': Symptom(),
    'BATTERY_CRITICAL': Symptom(),
    'BATTERY_DEPLETED': _says('batteryEmpty', ErrorLevel.FATAL, 'the battery is empty'),
    'PICK_FAILED': Symptom(),
    'LOAD_MISSING': Symptom(),
    'OVERWEIGHT': Symptom(),
    'MISFIT': Symptom(),
    'LOAD_DROPPED': _says('loadDropped', ErrorLevel.CRITICAL, 'the load has slid off'),
    'COMM_LOST': Symptom(),
    'EMERGENCY_STOP': Symptom(stands=True),
    'FIELD_VIOLATION': Symptom(stands=True),
    'OUTSIDE_OF_CORRIDOR': _says(
        'OUTSIDE_OF_CORRIDOR', ErrorLevel.CRITICAL, 'has left the corridor of its way'
    ),
    'OFF_PLAN': Symptom(),
    'ORDER_REJECTED': Symptom(),
    'CHARGER_FAULT': Symptom(),
    'SOFTWARE_CRASH': Symptom(stands=True),
    'UNKNOWN': _says('gearboxSings', ErrorLevel.CRITICAL, 'the gearbox sings'),
}

CODES: Final = tuple(_SYMPTOMS)

# Errors about an order; they go when the robot takes another one.
ORDER_ERRORS: Final = {
    'PICK_FAILED': 'pickFailed',
    'LOAD_MISSING': 'loadMissing',
    'OVERWEIGHT': 'overweight',
    'MISFIT': 'misfit',
}

_SLOWNESS: Final = {'STALLED': 6, 'DELAYED': 2}


def symptom(code: str) -> Symptom:
    """What a fault shows; one that is in no table says its code and stands."""
    known = _SYMPTOMS.get(code)
    return known or _says(code, ErrorLevel.CRITICAL, 'injected by hand')


def slowness(code: str) -> int:
    """How many times longer a robot with this fault takes for a cell."""
    return _SLOWNESS.get(code, 1)


class FaultPlan(NamedTuple):
    """Which faults happen by themselves.

    Attributes:
        mean_steps: Mean of the steps between two faults of one robot; 0: none by chance.
        schedule: (step, robot, code) of faults that happen for sure.
        codes: Those that chance takes.
    """

    mean_steps: float = 0.0
    schedule: tuple[tuple[int, str, str], ...] = ()
    codes: tuple[str, ...] = CODES


def read_fault(text: str, robots: Iterable[str]) -> tuple[int, str, str]:
    """The (step, robot, code) of a fault that is written as `ROBOT:CODE@STEP`.

    Raises:
        FaultError: It is written otherwise, or there is no such robot or code.
    """
    what, at, step = text.rpartition('@')
    robot, colon, code = what.rpartition(':')
    if not (at and colon and step.isdecimal()):
        raise FaultError(f'{text}: write a fault as ROBOT:CODE@STEP, as in carrier-01:STALLED@600')
    names = list(robots)
    if robot not in names:
        raise FaultError(f'{text}: no robot {robot}; {near_miss(robot, names)}')
    check_code(code)
    return int(step), robot, code


def check_code(code: str) -> None:
    """Say whether a simulated robot knows a code.

    Raises:
        FaultError: It does not.
    """
    if code not in CODES:
        raise FaultError(f'no failure {code}; {near_miss(code, list(CODES))}')


class Schedule:
    """Deals out the faults of a plan; the same seed gives the same ones."""

    def __init__(self, plan: FaultPlan, robots: tuple[str, ...], seed: int) -> None:
        self._plan = plan
        self._robots = robots
        self._random = Random(seed)  # noqa: S311 - chance that can be repeated, not a secret
        self._next = self._interval()
        self._fixed = sorted(plan.schedule, reverse=True)

    def due(self, step: int) -> list[tuple[str, str]]:
        """The (robot, code) whose time has come by this step."""
        due = []
        while self._fixed and self._fixed[-1][0] <= step:
            _, robot, code = self._fixed.pop()
            due.append((robot, code))
        while self._next <= step:
            due.append((self._random.choice(self._robots), self._random.choice(self._plan.codes)))
            self._next += self._interval()
        return due

    def start_at(self, step: int) -> None:
        """Leaves out what was due before, when a simulation goes on that was stopped."""
        while self._fixed and self._fixed[-1][0] <= step:
            self._fixed.pop()
        self._next += step

    def _interval(self) -> float:
        if not self._plan.mean_steps:
            return float('inf')
        return self._random.expovariate(len(self._robots) / self._plan.mean_steps)
