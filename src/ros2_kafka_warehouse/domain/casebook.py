"""The Monitor's casebook: every failure from its evidence to its end.

Diagnosis turns evidence into failures; `response` does something about each, step by step. What
is decided is carried out by others: by events, instant actions, and the report.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from ros2_kafka_warehouse.domain.evidence import Watch
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, Response
from ros2_kafka_warehouse.domain.failures import Failure, enter, response_to
from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.domain.monitor_memory import Memory
from ros2_kafka_warehouse.domain.robot_failure_profile import (
    Evidence,
    FailureRow,
    RobotFailureProfile,
    diagnose,
)
from ros2_kafka_warehouse.domain.signs import Signs
from ros2_kafka_warehouse.domain.standing import RISK_S
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import Blocked, FailureEvent
from ros2_kafka_warehouse.messages.robots import ErrorLevel, InstantAction
from ros2_kafka_warehouse.messages.tasks import TASK_ENDS, Task, Tasks

FLEET: Final = ''
VIOLATION: Final = 'VIOLATION'


# What has become of a failure whose evidence is gone.
_WORDS: Final = {
    'PATH_BLOCKED': 'it drives on',
    'NODE_UNREACHABLE': 'it has a way again',
    'NO_ROUTE': 'it can be done again',
    'DELAYED': 'it drives at its speed again',
    'STALLED': 'it drives at its speed again',
    'COMM_LOST': 'it is heard of again',
    'LOW_BATTERY': 'it is charged',
    'BATTERY_CRITICAL': 'it is charged',
    'EMERGENCY_STOP': 'the stop was released in time',
    'FIELD_VIOLATION': 'its field is free again in time',
    'OFF_PLAN': 'planned anew from where it is',
    'ORDER_REJECTED': 'it takes orders again',
    'CHARGER_FAULT': 'it does not need this charger any more',
    'SOFTWARE_CRASH': 'it is back, and gets its orders anew',
    'NO_PROGRESS': 'it goes on',
}


class Casebook:
    """All failures, and what is done about them.

    Attributes:
        memory: What must survive a restart.
        blocked: Cells that are to be driven around.
        step: Of the newest state.
        tasks: The newest.
        events: What has happened since they were taken last.
        actions: Instant actions, likewise.
        is_dirty: The memory has changed.
        is_stirred: How a robot stands may have changed.
    """

    def __init__(self, grid: Grid, watches: Mapping[str, Watch]) -> None:
        self._grid = grid
        self._watches = watches
        self.memory = Memory()
        self.blocked: dict[Cell, Blocked] = {}
        self.profiles = ExecutionProfiles()
        self.profile = RobotFailureProfile()
        self.step = 0
        self.tasks: Tasks | None = None
        self.events: list[FailureEvent] = []
        self.actions: list[InstantAction] = []
        self.is_dirty = self.is_stirred = False

    def diagnose(self, name: str, signs: Signs, now_s: float) -> None:
        """Bring the failures of a robot in line with the evidence that stands."""
        signs.changed = False
        self.is_dirty = self.is_stirred = True
        mine = [failure for failure in self.memory.failures if failure.robot == name]
        for key, evidence in signs.evidence.items():
            row = self._row(evidence)
            failure = next((one for one in mine if key in one.keys), None)
            if failure is None:
                mine.append(self._open(name, key, evidence, row, mine, now_s))
            elif failure.keys[key] != row.code:
                self._diagnose_anew(failure, key, evidence, row, mine, now_s)
        for failure in mine:
            for key in [key for key in failure.keys if key not in signs.evidence]:
                del failure.keys[key]
            if not failure.keys and not failure.gone and failure in self.memory.failures:
                self._lose_evidence(failure, now_s)

    def _row(self, evidence: Evidence) -> FailureRow:
        if evidence.sign == 'violation':
            return FailureRow(
                VIOLATION,
                cause='software',
                level=ErrorLevel.FATAL,
                next_step='look at what was broken, acknowledge, then resume',
            )
        return diagnose(evidence, self.profile)

    def _open(
        self,
        name: str,
        key: str,
        evidence: Evidence,
        row: FailureRow,
        mine: list[Failure],
        now_s: float,
    ) -> Failure:
        same = next(
            (
                one
                for one in mine
                if one.robot and (one.code == row.code or row.code in one.keys.values())
            ),
            None,
        )
        if same is not None:
            same.keys[key] = row.code
            if same.gone:
                self._open_again(same, evidence, row, now_s)
            return same
        cell = self._watches[name].state.cell if name else None
        what = key if name == FLEET else row.code
        failure = Failure(
            f'{name or "fleet"}@{self.step}:{what}',
            name,
            row.code,
            row.level,
            row.cause,
            evidence.text,
            now_s,
            cell,
            {key: row.code},
        )
        self.memory.failures.append(failure)
        failure.due_s = now_s
        self._tell(failure, row, now_s)
        return failure

    def _open_again(
        self, failure: Failure, evidence: Evidence, row: FailureRow, now_s: float
    ) -> None:
        """A robot that waited to be told to rejoin shows the same once more."""
        failure.gone = False
        failure.evidence = evidence.text
        enter(failure, row.code, now_s)
        self._tell(failure, row, now_s)

    def _tell(self, failure: Failure, row: FailureRow, now_s: float) -> None:
        """Say what was found and what will be done about it, and count it."""
        task_id = next(iter(self.tasks_of(failure.robot)), '')
        self.say('FailureDetected', failure, now_s, task_id=task_id)
        self._count(failure, self._tell_diagnosis(failure, row, now_s), now_s)

    def _tell_diagnosis(self, failure: Failure, row: FailureRow, now_s: float) -> Response:
        """Say what will be done about a failure, and what a person is to do."""
        response = response_to(row.code, self.profiles)
        planned = ', '.join(response.steps) or 'nothing'
        outcome = f'next step for a person: {row.next_step}' if row.next_step else ''
        self.say('FailureDiagnosed', failure, now_s, response=planned, outcome=outcome)
        return response

    def _count(self, failure: Failure, response: Response, now_s: float) -> None:
        """Remember the failure; one too many is answered otherwise."""
        if not failure.robot:
            return
        history = self.memory.history.setdefault(failure.robot, [])
        history[:] = [(code, at_s) for code, at_s in history if now_s - at_s < RISK_S]
        history.append((failure.code, now_s))
        if not response.repeats:
            return
        since_s = now_s - response.repeats_within_s
        times = sum(code == failure.code and at_s >= since_s for code, at_s in history)
        if times >= response.repeats:
            reason = f'{times} times within {response.repeats_within_s:g} s'
            self.escalate(failure, response.repeats_to, reason, now_s)

    def _diagnose_anew(
        self,
        failure: Failure,
        key: str,
        evidence: Evidence,
        row: FailureRow,
        mine: list[Failure],
        now_s: float,
    ) -> None:
        """The evidence has changed, and says something else now."""
        other = next((one for one in mine if one is not failure and one.code == row.code), None)
        if other is not None:
            del failure.keys[key]
            other.keys[key] = row.code
            return
        failure.keys[key] = row.code
        failure.gone = False
        if failure.code == row.code:
            return
        failure.level, failure.cause, failure.evidence = row.level, row.cause, evidence.text
        self.escalate(failure, row.code, evidence.text, now_s)
        self._tell_diagnosis(failure, row, now_s)

    def escalate(self, failure: Failure, code: str, reason: str, now_s: float) -> None:
        """Take a failure for another one, which is answered otherwise."""
        before = failure.code
        enter(failure, code, now_s)
        row = next((row for row in self.profile.rows if row.code == code), None)
        if row is not None:
            failure.level = row.level
        elif 'out_of_service' in response_to(code, self.profiles).steps:
            failure.level = ErrorLevel.FATAL
        self.say('FailureEscalated', failure, now_s, outcome=f'{before} became {code}: {reason}')

    def _lose_evidence(self, failure: Failure, now_s: float) -> None:
        if 'out_of_service' in failure.active:
            failure.gone = True
            failure.said = 'shows nothing any more, waits to be told to rejoin'
            self.say('ResponseOrdered', failure, now_s, response='wait', outcome=failure.said)
        elif failure.code == VIOLATION:
            failure.gone = True
        else:
            self.resolve(failure, _WORDS.get(failure.code, 'it goes on'), now_s)

    def block(self, cell: Cell, reason: str, now_s: float, until_s: float) -> None:
        """Have a cell driven around until a time; 0: until it is unblocked."""
        if self._grid.is_free(cell):
            self.blocked[cell] = Blocked(cell, reason, now_s, until_s)
            self.is_dirty = self.is_stirred = True

    def open_again(self, now_s: float) -> None:
        """Have cells and chargers tried again whose time is over."""
        if not any(end_s <= now_s for end_s in self._ends()):
            return
        self.blocked = {
            cell: blocked
            for cell, blocked in self.blocked.items()
            if not blocked.until_s or blocked.until_s > now_s
        }
        memory = self.memory
        memory.charger_until = {
            node: until_s for node, until_s in memory.charger_until.items() if until_s > now_s
        }
        for failure in memory.failures:
            if failure.area and failure.area_until_s <= now_s:
                failure.area = ()
        self.is_dirty = self.is_stirred = True

    def _ends(self) -> Iterator[float]:
        yield from (blocked.until_s for blocked in self.blocked.values() if blocked.until_s)
        yield from self.memory.charger_until.values()
        yield from (one.area_until_s for one in self.memory.failures if one.area)

    def tasks_of(self, name: str) -> list[str]:
        """What a robot has, or is to do."""
        if not name:
            return []
        loads = [load.load_id for load in self._watches[name].state.loads]
        given = [
            task.task_id
            for task in (self.tasks.tasks if self.tasks is not None else ())
            if task.robot == name and task.status not in TASK_ENDS
        ]
        return list(dict.fromkeys((*loads, *given)))

    def resolve(self, failure: Failure, outcome: str, now_s: float) -> None:
        """End a failure."""
        self.memory.failures.remove(failure)
        self.say('FailureResolved', failure, now_s, outcome=outcome)
        self.is_dirty = self.is_stirred = True

    def end_violation(self, now_s: float) -> None:
        """End the failures of broken rules."""
        for failure in [one for one in self.memory.failures if one.code == VIOLATION]:
            self.resolve(failure, 'acknowledged and resumed by the operator', now_s)

    def follow_tasks(self, tasks: Mapping[str, Task], now_s: float) -> None:
        """See who has the tasks that were taken from robots."""
        for failure in self.memory.failures:
            if failure.tasks:
                self._follow(failure, tasks, now_s)

    def _follow(self, failure: Failure, tasks: Mapping[str, Task], now_s: float) -> None:
        for task_id in list(failure.tasks):
            task = tasks.get(task_id)
            ended = task is None or task.status in TASK_ENDS
            if task is not None and task.robot not in ('', failure.robot):
                failure.tasks.remove(task_id)
                outcome = f'{task.robot} has it now'
                self.say('TaskReassigned', failure, now_s, outcome=outcome, task_id=task_id)
            elif ended:
                failure.tasks.remove(task_id)
                self.is_dirty = True
        kept = any(
            (task := tasks.get(task_id)) is not None and task.robot == failure.robot
            for task_id in failure.tasks
        )
        if 'release' in failure.active and not kept:
            failure.active.remove('release')
            self.is_dirty = self.is_stirred = True

    def rejoin(self, now_s: float) -> None:
        """Let robots back into service that were told to rejoin and show no evidence any more."""
        memory = self.memory
        for name, until_s in list(memory.rejoining.items()):
            mine = [
                one
                for one in memory.failures
                if one.robot == name and 'out_of_service' in one.active
            ]
            waits = [failure for failure in mine if not failure.gone]
            for failure in mine:
                if failure.gone:
                    self.resolve(failure, 'it was told to rejoin', now_s)
                elif now_s >= until_s:
                    outcome = f'it cannot rejoin: {failure.evidence}'
                    self.say('ResponseOrdered', failure, now_s, response='rejoin', outcome=outcome)
            if not waits or now_s >= until_s:
                del memory.rejoining[name]
                self.is_dirty = True

    def act(self, name: str, action_type: str) -> None:
        """Have a robot do something at once."""
        self.memory.sequence += 1
        self.is_dirty = True
        action_id = f'{action_type}-{name}-{self.step}-{self.memory.sequence}'
        self.actions.append(InstantAction(name, action_id, action_type))

    def say(
        self,
        event: str,
        failure: Failure,
        now_s: float,
        *,
        response: str = '',
        outcome: str = '',
        task_id: str = '',
    ) -> None:
        """Tell of a step in the life of a failure."""
        self.memory.sequence += 1
        self.is_dirty = True
        self.events.append(
            FailureEvent(
                failure.failure_id,
                event,
                now_s,
                failure.code,
                failure.robot,
                failure.cell,
                failure.level,
                failure.cause,
                failure.evidence,
                response,
                outcome,
                task_id,
                self.memory.sequence,
            )
        )
