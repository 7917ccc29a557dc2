"""Response: what is done about a failure, step by step, while its evidence lasts.

A failure is opened by the evidence of one code on one robot. Its steps come from the execution
profile. It ends when all its evidence is gone; or, if it has put the robot out of service, when
an operator has the robot rejoin.
"""

from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, Response
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.robots import ErrorLevel

ESCALATE: Final = 'escalate'
NEVER_S: Final = 1e18

LEVELS: Final = {level: rank for rank, level in enumerate(ErrorLevel)}

_REPEATED: Final = frozenset(('retry', 'resend', 'block_cell'))
_BY_STEPS: Final = frozenset((*_REPEATED, 'wait'))

# For a code that the execution profiles forgot: nothing can go wrong with a robot that stands.
_SAFE: Final = ('safe_stop', 'obstacle', 'reassign', 'out_of_service', 'call_operator')


class Failure(msgspec.Struct, rename='camel', omit_defaults=True):
    """A failure that has not ended.

    Attributes:
        robot: Its serial number; '' for the fleet as a whole.
        keys: The evidence that stands: its key -> the code that the profile has for it.
        step: The number of the next step of the response, done for the `tries`th time.
        due_s: When that is to be done.
        active: Steps that are in force until the failure ends.
        area: Cells around the robot that are closed until `area_until_s`.
        tasks: Those that were taken from the robot and that nobody else has yet.
        gone: All evidence is gone; the robot waits to be told to rejoin.
        said: The last step, in words.
    """

    failure_id: str
    robot: str
    code: str
    level: ErrorLevel
    cause: str
    evidence: str
    since_s: float
    cell: Cell | None = None
    keys: dict[str, str] = msgspec.field(default_factory=dict)
    step: int = 0
    tries: int = 0
    due_s: float = 0.0
    active: list[str] = msgspec.field(default_factory=list)
    area: tuple[Cell, ...] = ()
    area_until_s: float = 0.0
    tasks: list[str] = msgspec.field(default_factory=list)
    gone: bool = False
    said: str = ''


def response_to(code: str, profiles: ExecutionProfiles) -> Response:
    """What is done about a code; one that the profiles do not have is answered as UNKNOWN."""
    known = profiles.responses.get(code) or profiles.responses.get('UNKNOWN')
    return known if known is not None else Response(code, _SAFE)


def enter(failure: Failure, code: str, now_s: float) -> None:
    """Begin the response to a code; a robot that is out of service stays so."""
    failure.code = code
    failure.step = failure.tries = 0
    failure.due_s = now_s
    kept = ('reassign', 'out_of_service') if 'out_of_service' in failure.active else ()
    failure.active = [step for step in failure.active if step in kept]


def take_step(failure: Failure, response: Response, now_s: float) -> str:
    """The step that is due now, which then counts as done.

    Returns:
        A name out of `execution_profiles.STEPS`, `ESCALATE` when all were done in vain, or ''
        when none is due.
    """
    if failure.due_s > now_s:
        return ''
    if failure.step >= len(response.steps):
        failure.due_s = NEVER_S
        return ESCALATE if response.escalate_to else ''
    step = response.steps[failure.step]
    failure.tries += 1
    if step not in _REPEATED or failure.tries >= response.retries:
        failure.step += 1
        failure.tries = 0
    is_last = failure.step >= len(response.steps) and not failure.tries
    if step in _BY_STEPS or is_last:
        failure.due_s = now_s + response.wait_s
    return step
