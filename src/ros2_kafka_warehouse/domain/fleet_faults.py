"""The faults of the simulated fleet: when they come, what they do, and how they end."""

from collections.abc import Container, Mapping

from ros2_kafka_warehouse.domain.faults import CRASH_STEPS, REFUSALS, Schedule
from ros2_kafka_warehouse.domain.fleet_steps import Steps
from ros2_kafka_warehouse.domain.floor import Floor, is_next
from ros2_kafka_warehouse.domain.simulated_robot import SimulatedRobot
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.robots import RobotOrder


class FleetFaults:
    """Breaks and mends robots.

    Args:
        robots: Those of the fleet.
        floor: Where they are.
        schedule: Which faults happen by themselves.
        steps: Of the fleet.
    """

    def __init__(
        self,
        robots: Mapping[str, SimulatedRobot],
        floor: Floor,
        schedule: Schedule,
        steps: Steps,
    ) -> None:
        self._robots = robots
        self._floor = floor
        self._schedule = schedule
        self._steps = steps

    def break_(self, robot: SimulatedRobot, code: str) -> None:
        """Have a robot show a fault, from now on or the next time that it can."""
        if robot.removed:
            return
        battery = robot.kind.battery
        robot.faults[code] = 1
        match code:
            case 'LOW_BATTERY':
                del robot.faults[code]
                robot.charge = min(robot.charge, (battery.low + battery.critical) / 2)
            case 'BATTERY_CRITICAL':
                del robot.faults[code]
                robot.charge = min(robot.charge, battery.critical / 2)
            case 'BATTERY_DEPLETED':
                robot.charge = 0.0
            case 'LOAD_DROPPED':
                robot.faults[code] = 0
                self._drop_dropped(robot)
            case 'ORDER_REJECTED':
                robot.faults[code] = REFUSALS
            case 'SOFTWARE_CRASH':
                robot.faults[code] = self._steps.now + CRASH_STEPS
            case 'CHARGER_FAULT' if robot.charging:
                self.break_charger(robot)
            case _:
                pass
        robot.settle()
        self._steps.note_change()

    def _drop_dropped(self, robot: SimulatedRobot) -> None:
        """Lets the load of a robot with LOAD_DROPPED slide off, once there is one."""
        if robot.load is not None and robot.faults.get('LOAD_DROPPED') == 0:
            self._floor.put(robot.load, robot.cells[-1], to_station=False)
            robot.load = None
            robot.faults['LOAD_DROPPED'] = 1
            robot.settle()
            self._steps.note_change()

    def break_charger(self, robot: SimulatedRobot) -> None:
        """Have the charger under a robot charge nobody."""
        self._floor.chargers[robot.cell] = robot.serial_number
        robot.charging = False
        self.end_fault(robot, 'CHARGER_FAULT')

    def end_fault(self, robot: SimulatedRobot, code: str) -> None:
        """End a fault that has done what it does."""
        del robot.faults[code]
        robot.settle()
        self._steps.is_kept_old = True

    def repair(self, robot: SimulatedRobot) -> None:
        """Mend all that is broken on a robot."""
        self._floor.repair(robot.serial_number)
        robot.faults.clear()
        robot.order_errors.clear()
        robot.give_up_retries()
        battery = robot.kind.battery
        if robot.charge < battery.low:
            robot.charge = battery.target
        robot.settle()

    def happen(self) -> None:
        """The faults that are due, and what goes on with those that are there."""
        for name, code in self._schedule.due(self._steps.now):
            robot = self._robots.get(name)
            if robot is not None and not robot.faults:
                self.break_(robot, code)
        for robot in self._robots.values():
            if not robot.faults or robot.removed:
                continue
            self._drop_dropped(robot)
            if robot.faults.get('SOFTWARE_CRASH', self._steps.now) < self._steps.now:
                robot.restart()
                self.end_fault(robot, 'SOFTWARE_CRASH')

    def refusal(self, robot: SimulatedRobot, order: RobotOrder) -> str:
        """Why a robot that should do an order refuses it, or ''."""
        if not robot.faults.get('ORDER_REJECTED') or order == robot.order:
            return ''
        robot.faults['ORDER_REJECTED'] -= 1
        if not robot.faults['ORDER_REJECTED']:
            self.end_fault(robot, 'ORDER_REJECTED')
        return 'VALIDATION_FAILURE'

    def strayed(
        self, robot: SimulatedRobot, target: Cell, held: Container[Cell], taken: Container[Cell]
    ) -> Cell:
        """Where a robot with faults goes, instead of where it was ordered.

        Args:
            robot: Which one.
            target: Where it was ordered.
            held: The cells that robots hold.
            taken: Those to which robots are ordered.
        """
        if 'PATH_BLOCKED' in robot.faults and target not in held:
            self._floor.pallets[target] = robot.serial_number
            self.end_fault(robot, 'PATH_BLOCKED')
            self._steps.note_change()
        if 'OFF_PLAN' in robot.faults:
            column, row = robot.cell
            unseen = [
                cell
                for other in self._robots.values()
                if other.deaf and not other.removed
                for cell in other.cells
            ]
            for cell in (
                (column, row + 1),
                (column + 1, row),
                (column, row - 1),
                (column - 1, row),
            ):
                if not self._floor.is_open(cell) or cell in held or cell in taken:
                    continue
                # One that is silent was last seen where it is, or a cell before: nobody else
                # knows that it has left that.
                if not any(is_next(cell, other) for other in unseen):
                    self.end_fault(robot, 'OFF_PLAN')
                    return cell
        return target
