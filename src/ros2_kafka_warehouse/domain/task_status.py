"""The status of each task, from all that is known."""

from collections.abc import Mapping
from typing import Final

from msgspec.structs import replace

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.places import obstacles
from ros2_kafka_warehouse.domain.task_book import Entry, TaskBook
from ros2_kafka_warehouse.domain.task_maker import TaskMaker
from ros2_kafka_warehouse.messages.tasks import Assignments, Costs, Task, TaskStatus

_WITHDRAW_STEPS: Final = 6  # until a robot that was sent before would be seen to pick


class TaskStatuses:
    """Settles the status of the tasks of a book."""

    def __init__(self, book: TaskBook, maker: TaskMaker) -> None:
        self._book = book
        self._maker = maker

    def settle(
        self,
        picking: Mapping[str, str],
        costs: Costs | None,
        assignments: Assignments | None,
        profiles: ExecutionProfiles,
    ) -> None:
        """Settle all; `picking` says by which robots tasks are being picked."""
        assigned = {
            task_id: assignment.serial_number
            for assignment in (assignments.assignments if assignments is not None else ())
            for task_id in assignment.tasks
        }
        for task_id, entry in list(self._book.entries.items()):
            task = entry.task
            if entry.is_over:
                if task.order_id not in self._book.orders and task_id not in self._book.holders:
                    self._book.leave(task_id)
                continue
            reason = self._infeasible(entry, costs)
            if task.carried:
                status = TaskStatus.BLOCKED if reason else TaskStatus.CARRIED
                entry.set(status=status, reason=reason)
            elif task_id in picking:
                entry.set(status=TaskStatus.PICKING, robot=picking[task_id], reason='')
            else:
                if entry.picked >= task.attempt:
                    # The load was lost before it was seen; no robot does an action twice.
                    entry.set(attempt=entry.picked + 1)
                self._settle_waiting(entry, assigned.get(task_id, ''), reason, profiles)

    def _settle_waiting(
        self, entry: Entry, robot: str, reason: str, profiles: ExecutionProfiles
    ) -> None:
        """The status of a task whose load nobody has."""
        changing_step = None if entry.task.stranded else entry.changing_step
        since = changing_step if entry.withdrawn_step is None else entry.withdrawn_step
        if since is not None:
            if robot or self._book.step - since < _WITHDRAW_STEPS:
                entry.set(status=TaskStatus.OPEN, robot='', excluded=tuple(profiles.robot_types))
            elif entry.withdrawn_step is None:
                self._renew(entry.task)
            else:
                entry.set(
                    status=TaskStatus.CANCELLED, robot='', excluded=(), reason='no longer wanted'
                )
            return
        if lost := self._lost(entry, profiles):
            entry.set(status=TaskStatus.FAILED, robot='', excluded=(), reason=lost)
        elif entry.waits:
            entry.set(
                status=TaskStatus.BLOCKED,
                robot='',
                reason=entry.waits,
                excluded=tuple(profiles.robot_types),
            )
        elif reason:
            self._avoid_obstacle(entry)
            self._let_try_again(entry, profiles)
            entry.set(
                status=TaskStatus.BLOCKED, robot='', reason=reason, excluded=self._excluded(entry)
            )
        else:
            status = TaskStatus.ASSIGNED if robot else TaskStatus.OPEN
            entry.set(status=status, robot=robot, reason='', excluded=self._excluded(entry))

    def _renew(self, task: Task) -> None:
        """Makes the task anew, as it is wanted now."""
        order = self._book.orders[task.order_id]
        line = next(line for line in order.lines if line.line_id == task.line_id)
        wanted = self._maker.new_task(order, replace(line, place=None), task.task_id)
        renewed = replace(wanted, attempt=task.attempt + 1, released_s=task.released_s)
        self._book.entries[task.task_id] = entry = Entry(renewed)
        entry.changed_step = self._book.step

    def _infeasible(self, entry: Entry, costs: Costs | None) -> str:
        """Why no robot can do the task now, or ''; costs of an older form of it do not count."""
        if costs is None or costs.step < entry.changed_step:
            return entry.task.reason if entry.task.status is TaskStatus.BLOCKED else ''
        return costs.infeasible.get(entry.task.task_id, '')

    def _avoid_obstacle(self, entry: Entry) -> None:
        """Picks from another stock cell of the product, if the one that was chosen is blocked."""
        task = entry.task
        if task.stranded or self._book.report is None:
            return
        blocked = obstacles(self._book.report)
        others = [
            cell
            for cell in self._maker.stock(task)
            if cell not in blocked and cell not in entry.empty
        ]
        if task.pickup in blocked and others:
            entry.set(pickup=self._maker.nearest(others, task.delivery))
            entry.changed_step = self._book.step

    def _let_try_again(self, entry: Entry, profiles: ExecutionProfiles) -> None:
        """Rather a robot that could not pick it before than nobody; its tries are counted."""
        again = entry.unfit & self._book.robots.keys()
        able = self._maker.able(entry.task, profiles)
        if able <= entry.unfit:
            again |= able
        if again:
            entry.unfit -= again
            entry.changed_step = self._book.step

    def _excluded(self, entry: Entry) -> tuple[str, ...]:
        """Who may not take it; a robot that had to give it up, until it is in service again."""
        if entry.gave_up and not self._book.keeps(entry.gave_up):
            return tuple(sorted({*entry.unfit, entry.gave_up}))
        return tuple(sorted(entry.unfit))

    def _lost(self, entry: Entry, profiles: ExecutionProfiles) -> str:
        """Why no type of robot of this site will ever do the task, or ''."""
        task = entry.task
        if entry.waits and self._book.report is not None and not self._may_have(entry.gave_up):
            return f'{entry.waits}, and no robot has it'
        if self._maker.able(task, profiles):
            return ''
        return self._maker.unable(task)

    def _may_have(self, robot: str) -> bool:
        """Whether a robot that is not heard may still have a load; one that is heard shows it."""
        report = self._book.robots.get(robot)
        return report is not None and report.failure != 'REMOVED' and robot not in self._book.heard
