"""What the Monitor makes of the fleet, and what a person orders."""

from msgspec import field

from ros2_kafka_warehouse.messages.message import Cell, Message
from ros2_kafka_warehouse.messages.robots import ErrorLevel, RobotState

_COMMAND_LASTS_S = 60.0


class RobotReport(Message, frozen=True):
    """What the Monitor makes of one robot.

    Attributes:
        state: Its last state.
        seen_s: When that came.
        commissioned: It may get tasks; after a failure only when an operator says so.
        can_move: It may be given nodes to drive to.
        obstacle: The cells that it blocks for others as an obstacle, if it is one.
        keeps_task: False: what it carries or was to do goes to others.
        charge: '' no need, `soon` when its task is done, `now`: before anything else.
        failure: The code of its failure in the robot failure profile, or ''.
        level: Of that failure, or None.
        risk: Of failing during a task, 0 to 1, from its past.
        answer: What is being done about the failure.
    """

    serial_number: str
    state: RobotState
    seen_s: float
    commissioned: bool = True
    can_move: bool = True
    obstacle: tuple[Cell, ...] = ()
    keeps_task: bool = True
    charge: str = ''
    failure: str = ''
    level: ErrorLevel | None = None
    risk: float = 0.0
    answer: str = ''
    since_s: float = 0.0

    @property
    def is_off_the_floor(self) -> bool:
        """Whether it was carried away."""
        return not self.commissioned and not self.obstacle


class Blocked(Message, frozen=True):
    """A cell that is to be driven around, until it is tried again; 0: until it is unblocked."""

    cell: Cell
    reason: str
    since_s: float = 0.0
    until_s: float = 0.0


class FleetReport(Message, frozen=True):
    """`/monitor/fleet`: all robots, the cells that are blocked, and whether all must stand.

    `halted`: why no robot may move now (a pause, a violation of the rules), or ''. `floor` is
    that of the newest state, kept for the simulation; `memory` is the Monitor's own, for when it
    starts again.
    """

    step: int
    robots: tuple[RobotReport, ...] = ()
    blocked: tuple[Blocked, ...] = ()
    halted: str = ''
    faulty_chargers: tuple[Cell, ...] = ()
    floor: dict[str, str] = field(default_factory=dict)
    memory: str = ''


class FailureEvent(Message, frozen=True):
    """`/monitor/failures`, and from there Kafka: one step in the life of a failure.

    `event` is one of `FailureDetected`, `FailureDiagnosed`, `ResponseOrdered`,
    `FailureEscalated`, `TaskReassigned`, `FailureResolved`; those of one failure share
    `failure_id`. `(failure_id, sequence)` names an event: the same again is a repeat.
    """

    failure_id: str
    event: str
    time_s: float
    code: str = ''
    robot: str = ''
    cell: Cell | None = None
    level: ErrorLevel | None = None
    cause: str = ''
    evidence: str = ''
    response: str = ''
    outcome: str = ''
    task_id: str = ''
    sequence: int = 0


class OperatorCommand(Message, frozen=True):
    """`/operator/commands`, from Kafka: what a person orders. `command_id`: once only.

    `command`: `failRobot` (with `failure`: a code of the profile), `repairRobot`, `removeRobot`,
    `rejoinRobot`, `blockCell`, `unblockCell`, `pause`, `resume`, `acknowledge`.
    A blocked cell is known to nobody until a robot finds it, unless `known`. `time_s`: when it was
    given; 0: not said.
    """

    command_id: str
    command: str
    robot: str = ''
    failure: str = ''
    cell: Cell | None = None
    known: bool = False
    time_s: float = 0.0

    def is_old(self, now_s: float) -> bool:
        """Whether it has waited too long to be done: what it was given for has passed."""
        return self.time_s > 0 and now_s - self.time_s > _COMMAND_LASTS_S
