"""What the Monitor sees of the tasks: who has one, and which cannot be done."""

from collections.abc import Mapping
from typing import Final

from ros2_kafka_warehouse.domain.evidence import Watch
from ros2_kafka_warehouse.domain.failures import NEVER_S
from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.domain.signs import NO_PROGRESS, Signs
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.tasks import Task, Tasks, TaskStatus

BLOCKED_TASKS_SHOWN: Final = 20
DETOUR: Final = 1.5  # ways are longer than they look from above

_HAS_ROBOT: Final = frozenset((TaskStatus.ASSIGNED, TaskStatus.PICKING, TaskStatus.CARRIED))


class TaskWatch:
    """Follows the tasks, for evidence on them and for what robots have to do."""

    def __init__(self, grid: Grid, chargers: frozenset[Cell]) -> None:
        self._chargers = chargers
        self._furthest = 2 * (grid.width + grid.height)
        self._blocked_since: dict[str, float] = {}
        self._seen: Tasks | None = None

    def look(
        self,
        tasks: Tasks,
        watches: Mapping[str, Watch],
        signs: Signs,
        now_s: float,
        blocked_s: float,
    ) -> None:
        """Take in the newest tasks; one that is BLOCKED for `blocked_s` is evidence.

        Those are signs of the fleet: they may be nobody's fault.
        """
        if tasks is not self._seen:
            self._seen = tasks
            self._note(tasks, watches, now_s)
        elif not self._blocked_since:
            return
        self._show_blocked(tasks, signs, now_s - blocked_s)

    def _note(self, tasks: Tasks, watches: Mapping[str, Watch], now_s: float) -> None:
        by_id = {task.task_id: task for task in tasks.tasks}
        holders = {task.robot for task in tasks.tasks if task.status in _HAS_ROBOT}
        blocked = [task for task in tasks.tasks if task.status is TaskStatus.BLOCKED]
        waits = {task.robot for task in blocked if task.carried}
        for name, watch in watches.items():
            watch.has_task = name in holders
            if not watch.has_task and (not watch.ahead or name in waits):
                watch.signs.clear(NO_PROGRESS)
            watch.needed = self._needed(watch, by_id)
        self._blocked_since = {
            task.task_id: self._blocked_since.get(task.task_id, now_s) for task in blocked
        }

    def _needed(self, watch: Watch, tasks: Mapping[str, Task]) -> float:
        """Percent of the battery for the load that it has and the way to a charger."""
        if watch.kind is None or not self._chargers:
            return 0.0
        battery = watch.kind.battery
        most = battery.critical + DETOUR * self._furthest * battery.per_cell
        if watch.state.power_supply.state_of_charge > most:
            return 0.0
        here = watch.state.cell
        cells = 0
        for load in watch.state.loads:
            task = tasks.get(load.load_id)
            if task is not None:
                cells += _steps(here, task.delivery)
                here = task.delivery
        cells += min(_steps(here, charger) for charger in self._chargers)
        return battery.critical + DETOUR * cells * battery.per_cell

    def _show_blocked(self, tasks: Tasks, signs: Signs, limit_s: float) -> None:
        keys = {f'task:{task_id}' for task_id in self._blocked_since}
        for key in [key for key in signs.evidence if key.startswith('task:')]:
            if key not in keys:
                signs.clear(key)
        if not keys:
            return
        shown = sum(key.startswith('task:') for key in signs.evidence)
        for task in tasks.tasks:
            since_s = self._blocked_since.get(task.task_id, NEVER_S)
            key = f'task:{task.task_id}'
            if since_s <= limit_s and key not in signs and shown < BLOCKED_TASKS_SHOWN:
                text = f'task {task.task_id} cannot be done now: {task.reason}'
                signs.show(key, 'task_blocked', text, reason=task.reason, carried=task.carried)
                shown += 1


def _steps(one: Cell, other: Cell) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])
