"""The response to failures: what the profiles say is done about each, step by step."""

from collections.abc import Mapping
from itertools import chain
from typing import Final

from ros2_kafka_warehouse.domain.casebook import VIOLATION, Casebook
from ros2_kafka_warehouse.domain.evidence import Watch
from ros2_kafka_warehouse.domain.execution_profiles import STEPS, Response
from ros2_kafka_warehouse.domain.failures import ESCALATE, NEVER_S, Failure, response_to, take_step
from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.domain.standing import TAKES_TASKS
from ros2_kafka_warehouse.messages.message import Cell, node_cell

STEPS_AT_ONCE: Final = 50  # profiles of others may escalate in a circle
LONGEST_BLOCK: Final = 8  # times the time of the first one

_LASTING: Final = frozenset(
    (
        'slow', 'freeze', 'safe_stop', 'obstacle', 'release', 'reassign',
        'charge_soon', 'charge_now', 'call_operator', 'out_of_service',
    )
)  # fmt: skip


class Responder:
    """Does something about the failures of a casebook.

    Args:
        book: With the failures.
        grid: The cells around a robot that has failed.
        chargers: Where one may be that does not charge.
        watches: What is known of each robot.
    """

    def __init__(
        self,
        book: Casebook,
        grid: Grid,
        chargers: frozenset[Cell],
        watches: Mapping[str, Watch],
    ) -> None:
        self._book = book
        self._grid = grid
        self._chargers = chargers
        self._watches = watches

    def respond(self, now_s: float) -> None:
        """Do what is due."""
        for failure in list(self._book.memory.failures):
            if failure.due_s <= now_s and not failure.gone:
                self._respond(failure, now_s)

    def _respond(self, failure: Failure, now_s: float) -> None:
        self._book.is_dirty = self._book.is_stirred = True
        if failure.code == VIOLATION:
            failure.due_s = NEVER_S
            failure.said = 'all robots are told to stand'
            self._book.say(
                'ResponseOrdered', failure, now_s, response='halt', outcome=failure.said
            )
            return
        for _ in range(STEPS_AT_ONCE):
            response = response_to(failure.code, self._book.profiles)
            step = take_step(failure, response, now_s)
            if not step:
                return
            if step == ESCALATE:
                reason = 'all that could be done was done in vain'
                self._book.escalate(failure, response.escalate_to, reason, now_s)
            else:
                self._do(failure, step, response, now_s)

    def _do(self, failure: Failure, step: str, response: Response, now_s: float) -> None:
        if step in _LASTING and step not in failure.active:
            failure.active.append(step)
        watch = self._watches.get(failure.robot)
        outcome = STEPS.get(step, step)
        if step == 'wait':
            outcome = f'waits for {response.wait_s:g} s'
        elif watch is not None:
            outcome = self._do_to(failure, watch, step, response, now_s) or outcome
        failure.said = outcome
        task_id = failure.tasks[0] if step in TAKES_TASKS and failure.tasks else ''
        self._book.say(
            'ResponseOrdered', failure, now_s, response=step, outcome=outcome, task_id=task_id
        )

    def _do_to(
        self, failure: Failure, watch: Watch, step: str, response: Response, now_s: float
    ) -> str:
        """What a step does to a robot at once; returns the outcome if it is a special one."""
        name = failure.robot
        if step in TAKES_TASKS:
            return self._take_tasks(failure, watch, step)
        if step == 'retry':
            self._book.act(name, 'retry')
        elif step == 'cancel':
            self._book.act(name, 'cancelOrder')
        elif step == 'safety_area':
            failure.area = self._area(watch)
            failure.area_until_s = now_s + response.obstacle_s
        elif step == 'block_cell':
            return self._block_ahead(watch, response, now_s)
        elif step == 'other_charger' and watch.state.cell in self._chargers:
            self._book.memory.charger_until[watch.state.last_node_id] = now_s + response.obstacle_s
        return ''

    def _take_tasks(self, failure: Failure, watch: Watch, step: str) -> str:
        if step == 'release' and watch.carrying:
            failure.active.remove(step)
            return 'keeps the load that it has'
        failure.tasks = self._book.tasks_of(failure.robot)
        if not failure.tasks:
            if step == 'release':
                failure.active.remove(step)
            return 'it has no task'
        if step == 'reassign':  # or it would go on with them once it is mended
            self._book.act(failure.robot, 'cancelOrder')
        return f'its tasks go to others: {", ".join(failure.tasks)}'

    def _block_ahead(self, watch: Watch, response: Response, now_s: float) -> str:
        cell = node_cell(watch.ahead) if watch.ahead else None
        if cell is None or cell in self._book.blocked:
            return 'no other way is planned yet'
        tries = self._book.memory.block_tries.get(watch.ahead, 0) + 1
        self._book.memory.block_tries[watch.ahead] = tries
        for_s = response.obstacle_s * min(2 ** (tries - 1), LONGEST_BLOCK)
        name = watch.state.serial_number
        self._book.block(cell, f'{name} could not drive there', now_s, now_s + for_s)
        return f'cell {watch.ahead} is an obstacle for {for_s:g} s; planned around it'

    def _area(self, watch: Watch) -> tuple[Cell, ...]:
        held = set(chain.from_iterable(other.state.cells for other in self._watches.values()))
        around = chain.from_iterable(self._grid.neighbours(cell) for cell in watch.state.cells)
        return tuple(dict.fromkeys(cell for cell in around if cell not in held))
