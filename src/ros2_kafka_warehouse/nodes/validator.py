"""Validator: checks every step that was executed, and says which rule it broke.

What the others say of a step comes in any order. A state is checked with the tasks of the steps
before, once those of its own step show that no more of these will come, and with the reports up to
its own: these say which robots were taken off the floor.
"""

import time
from collections import deque
from typing import Final, Generic, NamedTuple, TypeVar

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.validator import Validator
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.orders import OpenOrders
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.messages.tasks import Tasks
from ros2_kafka_warehouse.nodes.node import Module

_QUIET_S: Final = 1.0
_PATIENCE_S: Final = 2.0  # for the tasks and the report of a step: their module may be away
_LOOK_S: Final = 0.5

S = TypeVar('S', Tasks, FleetReport)


def start(module: Module) -> None:
    """Check each state of the fleet; a violation is said at once, the count once a second."""
    _Validator(module)


class Before(Generic[S]):
    """Snapshots of one kind, given out by the step that they reflect."""

    def __init__(self) -> None:
        self._waiting: deque[S] = deque()
        self._newest_step = -1

    def add(self, snapshots: list[S]) -> None:
        """Let these wait."""
        self._waiting.extend(snapshots)
        if snapshots:
            self._newest_step = snapshots[-1].step

    def is_complete(self, step: int) -> bool:
        """Whether all snapshots of the steps before this one have come."""
        return self._newest_step >= step

    def take(self, step: int) -> list[S]:
        """The snapshots of the steps before this one."""
        taken = []
        while self._waiting and self._waiting[0].step < step:
            taken.append(self._waiting.popleft())
        return taken

    def take_newest(self) -> S | None:
        """The newest one; the others are forgotten."""
        newest = self._waiting[-1] if self._waiting else None
        self._waiting.clear()
        return newest


class _Came(NamedTuple):
    """A state, or open orders that came after the states before it."""

    message: FleetState | OpenOrders
    at_s: float

    @property
    def step(self) -> int:
        """The step whose tasks and report must be there first."""
        return self.message.step if isinstance(self.message, FleetState) else -1


def new_ones(found: ValidatorReport, said: ValidatorReport) -> list[Violation]:
    """The violations of a report that the one before did not have."""
    old = set(said.violations)
    return [violation for violation in found.violations if violation not in old]


class _Validator:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._validator = Validator(module.site)
        self._profiles = module.newest('/execution_profiles', ExecutionProfiles)
        self._orders = module.newest('/orders/open', OpenOrders)
        self._new_tasks = module.queue('/tasks', Tasks)
        self._new_reports = module.queue('/monitor/fleet', FleetReport)
        self._new_states = module.queue('/robots/state', FleetState)
        self._tasks: Before[Tasks] = Before()
        self._reports: Before[FleetReport] = Before()
        self._coming: deque[_Came] = deque()
        self._has_begun = False
        self._expected: OpenOrders | None = None
        self._speaker = module.speaker('/validator/report')
        self._said = ValidatorReport(step=0, checked=0)
        self._say_at_s = 0.0
        module.work_on(
            self._work,
            self._profiles, self._orders, self._new_tasks, self._new_reports, self._new_states,
        )  # fmt: skip
        module.each_s(_LOOK_S, module.ask)

    def _work(self) -> None:
        self._tasks.add(self._new_tasks.take())
        self._reports.add(self._new_reports.take())
        now_s = time.monotonic()
        self._coming.extend(_Came(state, now_s) for state in self._new_states.take())
        self._validator.profile(self._profiles.value)
        if not self._has_begun:
            self._begin()
        if self._orders.value is not self._expected:
            self._expected = self._orders.value
            self._coming.append(_Came(self._expected, now_s))
        while self._coming and self._is_due(self._coming[0]):
            message = self._coming.popleft().message
            if isinstance(message, FleetState):
                self._check(message)
            else:
                self._validator.expect(message)

    def _begin(self) -> None:
        """Take what the others say now as it is."""
        self._has_begun = True
        tasks, report = self._tasks.take_newest(), self._reports.take_newest()
        assert tasks is not None, 'the work needs one'
        assert report is not None, 'the work needs one'
        self._validator.know(tasks)
        self._validator.hear(report)
        self._expected = self._orders.value
        self._validator.expect(self._expected)
        known = max(tasks.step, report.step)
        self._coming = deque(one for one in self._coming if one.step >= known)

    def _is_due(self, came: _Came) -> bool:
        complete = self._tasks.is_complete(came.step) and self._reports.is_complete(came.step)
        return complete or time.monotonic() > came.at_s + _PATIENCE_S

    def _check(self, state: FleetState) -> None:
        for tasks in self._tasks.take(state.step):
            self._validator.know(tasks)
        for report in self._reports.take(state.step + 1):
            self._validator.hear(report)
        found = self._validator.check(state, self._module.now_s())
        is_news = found.violations != self._said.violations
        if is_news or time.monotonic() >= self._say_at_s:
            for violation in new_ones(found, self._said):
                self._module.log.error(
                    'step %d: %s: %s', violation.step, violation.rule, violation.description
                )
            self._said, self._say_at_s = found, time.monotonic() + _QUIET_S
            self._speaker.say(found)
