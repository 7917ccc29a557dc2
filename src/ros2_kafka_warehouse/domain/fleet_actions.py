"""What robots of the simulated fleet do where they stand: pick, drop, charge."""

from collections.abc import Mapping
from typing import Final

from ros2_kafka_warehouse.domain.faults import ORDER_ERRORS
from ros2_kafka_warehouse.domain.fleet_faults import FleetFaults
from ros2_kafka_warehouse.domain.fleet_steps import Steps
from ros2_kafka_warehouse.domain.floor import Floor, is_next
from ros2_kafka_warehouse.domain.simulated_robot import SimulatedRobot, Work
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.robots import Action, ActionStatus, Error, ErrorLevel, Load

_ORDER_TEXTS: Final = {
    'PICK_FAILED': 'the gripper did not get the load',
    'LOAD_MISSING': 'the load is not there',
    'OVERWEIGHT': 'the load is too heavy',
    'MISFIT': 'the load does not fit on the robot',
}


class FleetActions:
    """Has robots do their actions.

    Args:
        site: With its products and chargers.
        robots: Those of the fleet.
        floor: Where they are.
        faults: Of the robots.
        steps: Of the fleet.
    """

    def __init__(
        self,
        site: Site,
        robots: Mapping[str, SimulatedRobot],
        floor: Floor,
        faults: FleetFaults,
        steps: Steps,
    ) -> None:
        self._products = site.products
        self._chargers = frozenset(site.chargers)
        self._robots = robots
        self._floor = floor
        self._faults = faults
        self._steps = steps

    def work(self, robot: SimulatedRobot) -> None:
        """Goes on with the first action that has not ended."""
        work = robot.work[0]
        if robot.stuck or work.status is ActionStatus.RETRIABLE:
            return
        if work.status is ActionStatus.WAITING:
            work.left = self._duration(robot, work.action)
            work.status = ActionStatus.RUNNING
            robot.dirty = True
        work.left -= 1
        if work.left >= 0:
            robot.busy_step = self._steps.now
        if work.left <= 0:
            self._finish(robot, work)

    def _duration(self, robot: SimulatedRobot, action: Action) -> int:
        match action.action_type:
            case 'pick':
                return robot.kind.pick_steps
            case 'drop':
                return robot.kind.drop_steps
            case _:
                return 0

    def _finish(self, robot: SimulatedRobot, work: Work) -> None:
        match work.action.action_type:
            case 'pick':
                result = self._pick(robot, work.action)
            case 'drop':
                result = self._drop(robot, work.action)
            case 'startCharging':
                result = self._start_charging(robot)
            case other:
                result = f'INVALID_ORDER_ACTION: {other}'
        work.result = result
        work.status = ActionStatus.FAILED if result else ActionStatus.FINISHED
        if result == 'PICK_FAILED':
            work.status = ActionStatus.RETRIABLE
        if result in ORDER_ERRORS:
            references = (('actionId', work.action.action_id),)
            error_type = ORDER_ERRORS[result]
            robot.order_errors[error_type] = Error(
                error_type, ErrorLevel.CRITICAL, _ORDER_TEXTS[result], '', references
            )
            robot.settle()
        robot.sort_out()

    def _pick(self, robot: SimulatedRobot, action: Action) -> str:
        """Picks a load, and says what was in the way, or ''."""
        if robot.load is not None:
            return '' if robot.load.load_id == action.load_id else 'CARRIES_ANOTHER_LOAD'
        if fault := self._pick_fault(robot, action):
            return fault
        if not self._floor.is_issued(action.load_id):
            from_stock = action.source in (None, robot.cell)
            if not from_stock or not self._floor.issue(action.load_id, action.product, robot.cell):
                return 'LOAD_MISSING'
            robot.load = Load(action.load_id, action.product, action.weight_kg)
        else:
            robot.load = self._take_over(robot, action.load_id)
            if robot.load is None:
                return 'LOAD_MISSING'
        self._steps.is_kept_old = True
        return ''

    def _pick_fault(self, robot: SimulatedRobot, action: Action) -> str:
        if 'PICK_FAILED' in robot.faults:
            return 'PICK_FAILED'
        product = self._products.get(action.product)
        if action.weight_kg > robot.kind.max_load_kg:
            return 'OVERWEIGHT'
        if product is not None and product.size not in robot.kind.sizes:
            return 'MISFIT'
        for code in ('LOAD_MISSING', 'OVERWEIGHT', 'MISFIT'):
            if code in robot.faults:
                self._faults.end_fault(robot, code)
                return code
        return ''

    def _take_over(self, robot: SimulatedRobot, load_id: str) -> Load | None:
        """Takes a load that has left the stock: from the floor, or from a robot that stands."""
        place, load = self._floor.loads.get(load_id, (None, None))
        if place is not None and _is_in_reach(robot.cell, place):
            del self._floor.loads[load_id]
            return load
        holders = [
            other
            for other in self._robots.values()
            if other.load is not None and other.load.load_id == load_id
        ]
        if not holders:
            return None
        holder = holders[0]
        moves = holder.target is not None and not holder.stands
        if moves or not any(_is_in_reach(robot.cell, cell) for cell in holder.cells):
            return None
        load, holder.load = holder.load, None
        holder.dirty = True
        return load

    def _drop(self, robot: SimulatedRobot, action: Action) -> str:
        if robot.load is None or robot.load.load_id != action.load_id:
            return 'LOAD_MISSING'
        self._floor.put(robot.load, robot.cell)
        robot.load = None
        self._steps.is_kept_old = True
        return ''

    def _start_charging(self, robot: SimulatedRobot) -> str:
        if robot.cell not in self._chargers:
            return 'NO_CHARGER'
        if 'CHARGER_FAULT' in robot.faults:
            self._faults.break_charger(robot)
        if robot.cell in self._floor.chargers:
            return 'CHARGER_FAULT'
        robot.charging = True
        return ''


def _is_in_reach(cell: Cell, load: Cell) -> bool:
    return cell == load or is_next(cell, load)
