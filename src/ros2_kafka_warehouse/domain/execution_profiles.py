"""What each type of robot can do, and what is done about each failure."""

from pathlib import Path
from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.profile_files import ProfileFile, near_miss
from ros2_kafka_warehouse.messages.message import Message

DEFAULT_FILE: Final = Path(__file__).parent.parent / 'data' / 'execution_profiles.yaml'

# The steps of a response, as said in words to a person.
STEPS: Final = {
    'wait': 'waits',
    'retry': 'tries its action again',
    'resend': 'gets its order anew',
    'cancel': 'its order is cancelled',
    'block_cell': 'drives around the cell ahead, which is an obstacle for a while',
    'slow': 'counts as slow',
    'freeze': 'gets no nodes, its cells are closed',
    'safe_stop': 'is paused',
    'safety_area': 'the cells around it are closed',
    'obstacle': 'is an obstacle for others',
    'release': 'what it has not picked yet goes to others',
    'reassign': 'its tasks go to others',
    'charge_soon': 'charges when its task is done',
    'charge_now': 'charges before anything else',
    'other_charger': 'goes to another charger',
    'exclude': 'the task goes to another robot or type',
    'call_operator': 'the operator is called',
    'out_of_service': 'is out of service until told to rejoin',
}

_REPEATED: Final = frozenset({'retry', 'resend', 'block_cell'})


class Battery(Message, frozen=True):
    """In percent of the charge; used and charged for each step.

    Attributes:
        critical: Below it the robot charges before anything else.
        low: Below it the robot charges when its task is done.
        target: To here it charges before it takes tasks again.
    """

    per_cell: float = 0.05
    per_idle_step: float = 0.005
    charge_per_step: float = 0.5
    critical: float = 10.0
    low: float = 25.0
    target: float = 80.0


class RobotType(Message, frozen=True):
    """The factsheet of a type of robot (VDA 5050).

    Attributes:
        max_load_kg: The heaviest load that it carries.
        sizes: Sizes of products that it can carry.
        steps_per_cell: Steps of the fleet that it takes from one cell to the next.
        pick_steps: Steps that it stands still to pick; 0: picks in the step in which it arrives.
    """

    name: str
    width_m: float = 0.8
    length_m: float = 0.9
    max_load_kg: float = 50.0
    sizes: tuple[str, ...] = ('small',)
    steps_per_cell: int = 1
    pick_steps: int = 2
    drop_steps: int = 2
    battery: Battery = Battery()


class Response(Message, frozen=True):
    """What is done about one failure while its evidence lasts; see `monitor`.

    Attributes:
        steps: Names out of `STEPS`, in order.
        retries: How often `retry`, `resend` and `block_cell` are done, `wait_s` apart.
        wait_s: How long `wait` waits, and the last step before it escalates.
        escalate_to: The code whose response comes next when all steps were done in vain.
        obstacle_s: How long a cell or a charger that was found bad is not used.
        repeats: With so many failures of this code within `repeats_within_s`, the newest one of
            a robot is answered as `repeats_to`; 0: never.
    """

    code: str
    steps: tuple[str, ...] = ()
    retries: int = 0
    wait_s: float = 0.0
    escalate_to: str = ''
    obstacle_s: float = 60.0
    repeats: int = 0
    repeats_within_s: float = 600.0
    repeats_to: str = 'OUT_OF_SERVICE'


class ExecutionProfiles(Message, frozen=True):
    """`/execution_profiles`: robot types by name, responses by the code of the failure."""

    robot_types: dict[str, RobotType] = msgspec.field(default_factory=dict)
    responses: dict[str, Response] = msgspec.field(default_factory=dict)


def read_execution_profiles(path: Path = DEFAULT_FILE) -> ExecutionProfiles:
    """The profiles in a YAML file.

    Raises:
        ProfileError: Every mistake in it, with file, line, field and what would be right.
    """
    file = ProfileFile(path, ('robot_types', 'responses'))
    robot_types = {
        name: file.message(RobotType, 'robot_types', name, name=name)
        for name in file.names('robot_types')
    }
    responses = {
        code: file.message(Response, 'responses', code, code=code)
        for code in file.names('responses')
    }
    if not robot_types:
        file.wrong('there must be a robot type at least', 'robot_types')
    file.check()
    profiles = ExecutionProfiles(
        {name: kind for name, kind in robot_types.items() if kind},
        {code: response for code, response in responses.items() if response},
    )
    for kind in profiles.robot_types.values():
        _check_type(file, kind)
    for response in profiles.responses.values():
        _check_response(file, response, profiles.responses)
    file.check()
    return profiles


def _check_type(file: ProfileFile, kind: RobotType) -> None:
    battery = kind.battery
    thresholds = f'critical {battery.critical:g}, low {battery.low:g}, target {battery.target:g}'
    rules = (
        (('max_load_kg',), kind.max_load_kg > 0, 'must be more than 0'),
        (('width_m',), kind.width_m > 0, 'must be more than 0'),
        (('length_m',), kind.length_m > 0, 'must be more than 0'),
        (('sizes',), bool(kind.sizes), 'must name a size of product at least'),
        (('steps_per_cell',), kind.steps_per_cell >= 1, 'must be 1 or more'),
        (('pick_steps',), kind.pick_steps >= 0, 'must be 0 or more'),
        (('drop_steps',), kind.drop_steps >= 0, 'must be 0 or more'),
        (('battery', 'per_cell'), battery.per_cell >= 0, 'must be 0 or more'),
        (('battery', 'per_idle_step'), battery.per_idle_step >= 0, 'must be 0 or more'),
        (('battery', 'charge_per_step'), battery.charge_per_step > 0, 'must be more than 0'),
        (
            ('battery',),
            0 <= battery.critical < battery.low < battery.target <= 100,
            f'must be 0 <= critical < low < target <= 100 (percent), is {thresholds}',
        ),
    )
    for field, right, text in rules:
        if not right:
            file.wrong(text, 'robot_types', kind.name, *field)


def _check_response(file: ProfileFile, response: Response, responses: dict[str, Response]) -> None:
    place = ('responses', response.code)
    for number, step in enumerate(response.steps):
        if step not in STEPS:
            file.wrong(
                f"no step '{step}'; {near_miss(step, list(STEPS))}", *place, 'steps', number
            )
    targets = {'escalate_to': response.escalate_to}
    if response.repeats:
        targets['repeats_to'] = response.repeats_to
    for field, target in targets.items():
        if target and target not in responses:
            text = f"no response '{target}'; {near_miss(target, list(responses))}"
            file.wrong(text, *place, field)
    if _escalates_for_ever(responses, response.code):
        file.wrong('leads back to itself', *place, 'escalate_to')
    if response.retries < 1 and _REPEATED.intersection(response.steps):
        repeated = ', '.join(step for step in response.steps if step in _REPEATED)
        file.wrong(f'must be 1 or more with {repeated}', *place, 'retries')
    for field in ('retries', 'wait_s', 'obstacle_s', 'repeats', 'repeats_within_s'):
        if getattr(response, field) < 0:
            file.wrong('must be 0 or more', *place, field)


def _escalates_for_ever(responses: dict[str, Response], code: str) -> bool:
    seen = set()
    at = code
    while at in responses and at not in seen:
        seen.add(at)
        at = responses[at].escalate_to
    return at == code
