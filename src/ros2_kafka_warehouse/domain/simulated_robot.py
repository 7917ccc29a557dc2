"""One simulated robot: what it holds, carries and has been told, and the state that it reports."""

from collections import deque
from math import atan2
from typing import Final

from ros2_kafka_warehouse.domain.execution_profiles import RobotType
from ros2_kafka_warehouse.domain.faults import slowness, symptom
from ros2_kafka_warehouse.domain.site import RobotPlace
from ros2_kafka_warehouse.messages.message import Cell, node_cell, node_id
from ros2_kafka_warehouse.messages.robots import (
    Action,
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    Load,
    Position,
    PowerSupply,
    RobotOrder,
    RobotState,
    SafetyState,
)

_ENDED: Final = (ActionStatus.FINISHED, ActionStatus.FAILED)
_RUNNING: Final = (ActionStatus.INITIALIZING, ActionStatus.RUNNING, ActionStatus.PAUSED)
_SAFE: Final = SafetyState()
_REPORTED_CHARGE: Final = 0.1  # percent; a smaller change is no news


class Work:
    """An action that has not ended, with the steps that it still takes."""

    __slots__ = ('action', 'left', 'result', 'status')

    def __init__(self, action: Action) -> None:
        self.action = action
        self.left = 0
        self.result = ''
        self.status = ActionStatus.WAITING

    @property
    def state(self) -> ActionState:
        """As the robot reports it."""
        return ActionState(
            self.action.action_id, self.action.action_type, self.status, self.result
        )


class SimulatedRobot:
    """One robot of the fleet; the Fleet moves it.

    Attributes:
        cell: Where it stands, or whence it drives.
        target: Where it drives, or None; it holds both cells.
        left: Steps that it still needs to the target.
        faults: Codes of what is broken; the value is the fleet's: 0 waits for its occasion.
        order_errors: What it says of its order until it takes another, by type.
        stuck: A fault or a pause keeps it from doing anything.
        stands: It does not drive: it is stuck, or cannot go on with its order.
        busy_step: The last step in which it stood still for an action.
        deaf: It neither hears nor is heard.
        removed: It is not on the floor.
        dirty: Its last state is no longer true.
    """

    def __init__(self, place: RobotPlace, kind: RobotType, cell_m: float) -> None:
        self.serial_number = place.serial_number
        self.kind = kind
        self.home = place.home
        self.cell: Cell = place.home
        self.target: Cell | None = None
        self.left = 0
        self.charge = 100.0
        self.charging = False
        self.order: RobotOrder | None = None
        self.work: list[Work] = []
        self.load: Load | None = None
        self.faults: dict[str, int] = {}
        self.order_errors: dict[str, Error] = {}
        self.paused = False
        self.stuck = False
        self.stands = False
        self.busy_step = 0
        self.deaf = False
        self.removed = False
        self.dirty = True
        self.steps_per_cell = kind.steps_per_cell
        self._cell_m = cell_m
        self._theta = 0.0
        self._order_id = ''
        self._order_update_id = 0
        self._sequence_id = 0
        self._next_sequence_id = 0
        self._ended: deque[ActionState] = deque(maxlen=10)
        self._header_id = 0
        self._state: RobotState | None = None

    # Orders.

    def refusal(self, order: RobotOrder) -> str:
        """Why it cannot take an order (VDA 5050, 6.1.4), as an errorType, or ''."""
        if order.order_id == self._order_id:
            if order.order_update_id < self._order_update_id:
                return 'OUTDATED_ORDER_UPDATE'
            if order.order_update_id == self._order_update_id:
                # After a crash or a restart of the simulation it no longer knows the content.
                return 'SAME_ORDER_UPDATE_ID' if order != self.order and self.order else ''
        elif any(work.status in _RUNNING for work in self.work):
            return 'OTHER_ORDER_ACTIVE'
        first = node_cell(order.nodes[0].node_id) if order.nodes else None
        return '' if first in (self.cell, self.target) else 'START_NODE_OUT_OF_RANGE'

    def refuse(self, order: RobotOrder, error_type: str) -> None:
        """Reports that it has not taken an order."""
        references = (('orderId', order.order_id),)
        error = Error(error_type, ErrorLevel.WARNING, 'order refused', '', references)
        if self.order_errors.get(error_type) != error:
            self.order_errors[error_type] = error
            self.settle()

    def take(self, order: RobotOrder) -> Cell | None:
        """Takes an order that it cannot refuse; returns the cell that is released to it.

        The same order again changes nothing and releases nothing.
        """
        if order == self.order:
            return None
        if order.order_id != self._order_id:
            for work in self.work:
                work.status, work.result = ActionStatus.FAILED, 'replaced by another order'
            self.sort_out()
            self.order_errors.clear()
            self.settle()
        elif self.order_errors:
            self._forgive()
        self.order = order
        self._order_id = order.order_id
        self._order_update_id = order.order_update_id
        self.dirty = True
        first = order.nodes[0]
        if self.target is not None:
            return None
        self._sequence_id = first.sequence_id
        if first.actions:
            self._note(first.actions)
        if len(order.nodes) > 1 and order.nodes[1].released:
            self._next_sequence_id = order.nodes[1].sequence_id
            return node_cell(order.nodes[1].node_id)
        return None

    def _forgive(self) -> None:
        for error_type, error in list(self.order_errors.items()):
            if error.error_level is ErrorLevel.WARNING:
                del self.order_errors[error_type]
        self.settle()

    def _note(self, actions: tuple[Action, ...]) -> None:
        """Adds actions that it has not begun yet: an id is done once, but for charging."""
        known = {work.action.action_id for work in self.work}
        known.update(it.action_id for it in self._ended if it.action_type != 'startCharging')
        self.work += [Work(action) for action in actions if action.action_id not in known]

    # Actions.

    def sort_out(self) -> None:
        """Puts actions that have ended to the ended ones."""
        ended = {work.action.action_id: work.state for work in self.work if work.status in _ENDED}
        before = [state for state in self._ended if state.action_id not in ended]
        self._ended = deque((*before, *ended.values()), maxlen=10)
        self.work = [work for work in self.work if work.status not in _ENDED]
        self.dirty = True

    def give_up_retries(self) -> None:
        """Ends actions that could be tried again: who repaired it starts with a clean slate."""
        for work in self.work:
            if work.status is ActionStatus.RETRIABLE:
                work.status, work.result = ActionStatus.FAILED, 'cancelled'
        self.sort_out()

    def cancel(self) -> None:
        """Ends its order: what was to be done has failed; it drives to the next cell only."""
        for work in self.work:
            work.status = ActionStatus.FAILED
            work.result = work.result or 'cancelled'
        self.sort_out()
        self.forget_order()
        self.order_errors.clear()
        self.settle()

    def forget_order(self) -> None:
        """Knows no order any more, as after a start."""
        self.order = None
        self._order_id, self._order_update_id, self._sequence_id = '', 0, 0
        self.dirty = True

    def restart(self) -> None:
        """Its software starts anew: loads and ended actions are remembered, nothing else."""
        self.work.clear()
        self.order_errors.clear()
        self.forget_order()
        self._header_id = 0
        self.settle()

    # Driving.

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The cells that it holds."""
        return (self.cell,) if self.target is None else (self.cell, self.target)

    def depart(self, target: Cell) -> None:
        """Begins to drive; with one step to a cell it is there at once."""
        self._theta = atan2(target[1] - self.cell[1], target[0] - self.cell[0])
        self.charging = False
        self.target = target
        self.left = self.steps_per_cell
        self.go_on()

    def go_on(self) -> None:
        """Drives for one step."""
        self.left -= 1
        self.dirty = True
        if self.left <= 0 and self.target is not None:
            self.cell, self.target = self.target, None
            self._sequence_id = self._next_sequence_id
            self.drain(self.kind.battery.per_cell)

    def drain(self, percent: float) -> None:
        """Takes from the battery."""
        self.charge -= percent
        if self.charge <= 0:
            self.charge = 0.0
            if 'BATTERY_DEPLETED' not in self.faults:
                self.faults['BATTERY_DEPLETED'] = 1
                self.settle()

    # State.

    def settle(self) -> None:
        """Works out what follows from its faults; after each change of them."""
        faults = self.faults
        self.deaf = 'COMM_LOST' in faults or 'SOFTWARE_CRASH' in faults
        self.stuck = self.paused or any(
            active and symptom(code).stands for code, active in faults.items()
        )
        self.stands = self.stuck or any(
            error.error_level is not ErrorLevel.WARNING for error in self.order_errors.values()
        )
        factor = max((slowness(code) for code in faults), default=1)
        self.steps_per_cell = self.kind.steps_per_cell * factor
        self.dirty = True

    def state(self) -> RobotState:
        """What it reports; the same value again as long as nothing has changed."""
        last = self._state
        if last is None or self.dirty or self._charge_is_news(last.power_supply):
            last = self._state = self._new_state()
            self.dirty = False
        return last

    def _charge_is_news(self, reported: PowerSupply) -> bool:
        return (
            abs(reported.state_of_charge - self.charge) >= _REPORTED_CHARGE
            or reported.charging != self.charging
        )

    def _new_state(self) -> RobotState:
        self._header_id += 1
        return RobotState(
            header_id=self._header_id,
            serial_number=self.serial_number,
            robot_type=self.kind.name,
            last_node_id=node_id(self.cell),
            position=self._position(),
            power_supply=PowerSupply(round(self.charge, 1), self.charging),
            order_id=self._order_id,
            order_update_id=self._order_update_id,
            last_node_sequence_id=self._sequence_id,
            driving=self.target is not None,
            paused=self.paused,
            node_states=() if self.target is None else (node_id(self.target),),
            action_states=(*(work.state for work in self.work), *self._ended),
            loads=() if self.load is None else (self.load,),
            errors=self._errors() if self.faults or self.order_errors else (),
            safety_state=self._safety() if self.faults else _SAFE,
        )

    def _position(self) -> Position:
        x, y = float(self.cell[0]), float(self.cell[1])
        if self.target is not None:
            driven = 1 - self.left / self.steps_per_cell
            x += driven * (self.target[0] - x)
            y += driven * (self.target[1] - y)
        size = self._cell_m
        localized = 'LOCALIZATION_ERROR' not in self.faults
        return Position(
            round((x + 0.5) * size, 3), round((y + 0.5) * size, 3), self._theta, localized
        )

    def _errors(self) -> tuple[Error, ...]:
        said = (symptom(code).error for code, active in self.faults.items() if active)
        return (*(error for error in said if error), *self.order_errors.values())

    def _safety(self) -> SafetyState:
        stop = 'MANUAL' if 'EMERGENCY_STOP' in self.faults else 'NONE'
        return SafetyState(stop, 'FIELD_VIOLATION' in self.faults)

    def resume(self, state: RobotState) -> None:
        """Goes on from a state that it has reported; its faults are the Fleet's to give."""
        self.cell = state.cell
        self.target = node_cell(state.node_states[0]) if state.driving else None
        self.left = 1
        self._theta = state.position.theta
        self.charge = state.power_supply.state_of_charge
        self.charging = state.power_supply.charging
        self.load = state.loads[0] if state.loads else None
        self.paused = state.paused
        self._order_id = state.order_id
        self._order_update_id = state.order_update_id
        self._sequence_id = self._next_sequence_id = state.last_node_sequence_id
        self._header_id = state.header_id
        # What was running has to be ordered again, under the same id.
        self._ended.clear()
        self._ended.extend(it for it in state.action_states if it.action_status in _ENDED)
        self.work.clear()
        if not self.charge:
            self.faults['BATTERY_DEPLETED'] = 1
        own = {item.error_type for item in (symptom(code).error for code in self.faults) if item}
        self.order_errors = {
            error.error_type: error for error in state.errors if error.error_type not in own
        }
        self.settle()
