"""Plans for those who look on, and the word of the validator."""

from ros2_kafka_warehouse.messages.message import Cell, Message


class Plan(Message, frozen=True):
    """The way of one robot as foreseen now: cells from where it is to its goal."""

    serial_number: str
    path: tuple[Cell, ...]
    task_id: str = ''
    purpose: str = ''  # pick, drop, charge, yield


class Plans(Message, frozen=True):
    """`/path_planner/plans`: the ways of all robots that have a goal; planner time in ms."""

    step: int
    plans: tuple[Plan, ...] = ()
    planner_ms: float = 0.0
    stuck: int = 0  # robots without progress that were given the right of way


class Violation(Message, frozen=True):
    """A rule that a trace has broken."""

    step: int
    rule: str
    description: str
    robots: tuple[str, ...] = ()


class ValidatorReport(Message, frozen=True):
    """`/validator/report`: how many steps were checked, and what was broken."""

    step: int
    checked: int
    violations: tuple[Violation, ...] = ()
