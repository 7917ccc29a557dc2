"""The simulated fleet: robots on a floor, which do what they are ordered and never meet.

One `step` is one tick of the floor. The Fleet knows what is physically true; its states tell only
what robots would tell. Whatever comes in as orders, no two robots hold a cell, and none drives
through a wall: each has a scanner that stops it.
"""

from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.faults import FaultPlan, Schedule
from ros2_kafka_warehouse.domain.fleet_actions import FleetActions
from ros2_kafka_warehouse.domain.fleet_faults import FleetFaults
from ros2_kafka_warehouse.domain.fleet_steps import Steps
from ros2_kafka_warehouse.domain.floor import Floor, granted, is_next
from ros2_kafka_warehouse.domain.simulated_robot import SimulatedRobot
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport, OperatorCommand
from ros2_kafka_warehouse.messages.robots import (
    ActionStatus,
    FleetOrders,
    FleetState,
    InstantAction,
    InstantActions,
    RobotState,
)

_AWAY_STEPS: Final = 4  # at least, between taking a robot off the floor and putting it back
_RESTART_STEPS: Final = 10  # between the last step that others may have seen and the next one
_COMMANDS: Final = 50  # ids of commands that are remembered, to obey each once


class _Kept(msgspec.Struct, omit_defaults=True):
    """What the fleet keeps of itself in `FleetState.floor`, beside its robots' states."""

    faults: dict[str, dict[str, int]] = {}
    removed: list[str] = []
    rejoining: list[str] = []
    silent: dict[str, RobotState] = {}
    commands: list[str] = []


class Fleet:
    """All robots of a site.

    Args:
        site: Where they are.
        profiles: What their types can do.
        seed: Of chance: which faults happen when, and where a robot without a plan goes.
        faults: Faults that happen by themselves.

    Raises:
        ValueError: A robot is of a type that the profiles do not have.
    """

    def __init__(
        self,
        site: Site,
        profiles: ExecutionProfiles,
        seed: int = 0,
        faults: FaultPlan = FaultPlan(),  # noqa: B008 - a value that nobody can change
    ) -> None:
        for name, place in site.robots.items():
            if place.robot_type not in profiles.robot_types:
                known = ', '.join(profiles.robot_types)
                raise ValueError(
                    f'robot {name} is of type {place.robot_type}; the execution profiles have '
                    f'{known}'
                )
        self._floor = Floor(site)
        self._robots = {
            name: SimulatedRobot(place, profiles.robot_types[place.robot_type], site.cell_m)
            for name, place in site.robots.items()
        }
        self._held = {robot.cell: robot for robot in self._robots.values()}
        self._schedule = Schedule(faults, tuple(site.robots), seed)
        self._steps = Steps()
        self._faults = FleetFaults(self._robots, self._floor, self._schedule, self._steps)
        self._actions = FleetActions(site, self._robots, self._floor, self._faults, self._steps)
        self._orders: FleetOrders | None = None
        self._rejoining: dict[str, None] = {}
        self._removed_steps: dict[str, int] = {}
        self._commands: dict[str, None] = {}
        self._instant_actions: dict[str, None] = {}
        self._kept: dict[str, str] = {}

    # What the others say.

    def order(self, orders: FleetOrders) -> None:
        """Orders for the next step; the newest count."""
        self._orders = orders

    def act(self, actions: InstantActions) -> None:
        """Does what is to be done at once; the same action id again does nothing."""
        for action in actions.actions:
            robot = self._robots.get(action.serial_number)
            if robot is None or robot.removed or robot.deaf or self._is_repeat(action):
                continue
            self._act(robot, action.action_type)

    def _is_repeat(self, action: InstantAction) -> bool:
        if action.action_id in self._instant_actions:
            return True
        _remember(self._instant_actions, action.action_id)
        return False

    def _act(self, robot: SimulatedRobot, action_type: str) -> None:
        match action_type:
            case 'startPause' | 'stopPause':
                robot.paused = action_type == 'startPause'
                robot.settle()
            case 'cancelOrder':
                robot.cancel()
            case 'retry':
                self._retry(robot)
            case 'stopCharging':
                robot.charging = False
            case _:
                pass  # VDA 5050 knows more of them than a warehouse needs

    def _retry(self, robot: SimulatedRobot) -> None:
        for work in robot.work:
            if work.status is ActionStatus.RETRIABLE:
                work.status, work.result = ActionStatus.WAITING, ''
                robot.order_errors.clear()
                robot.settle()

    def operate(self, command: OperatorCommand) -> None:
        """Does what a person orders: faults, repairs, pallets. A command id counts once."""
        if command.command_id in self._commands:
            return
        _remember(self._commands, command.command_id)
        self._steps.note_change()
        robot = self._robots.get(command.robot)
        match command.command:
            case 'failRobot' if robot is not None:
                self._faults.break_(robot, command.failure or 'UNKNOWN')
            case 'repairRobot' if robot is not None:
                self._faults.repair(robot)
            case 'removeRobot' if robot is not None:
                self._remove(robot)
            case 'rejoinRobot' if robot is not None and robot.removed:
                self._rejoining[robot.serial_number] = None
            case 'blockCell' if command.cell in self._floor.free:
                self._floor.waiting[command.cell] = None
            case 'unblockCell' if command.cell is not None:
                self._floor.waiting.pop(command.cell, None)
                self._floor.pallets.pop(command.cell, None)
            case _:
                pass  # not the Fleet's business

    def _remove(self, robot: SimulatedRobot) -> None:
        if robot.removed:
            self._rejoining.pop(robot.serial_number, None)
            return
        for cell in robot.cells:
            del self._held[cell]
        if robot.load is not None:
            # Between two cells it is put where the robot was going: there it is looked for.
            self._floor.put(robot.load, robot.cells[-1], to_station=False)
            robot.load = None
        robot.removed = True
        self._removed_steps[robot.serial_number] = self._steps.now

    def _rejoin(self) -> None:
        """Puts removed robots to their homes again, mended, when those are free."""
        if not self._rejoining:
            return
        # Others still see there who has just been removed.
        gone = [robot for robot in self._robots.values() if self._is_just_gone(robot)]
        left = {cell for robot in gone for cell in robot.cells}
        for name in list(self._rejoining):
            robot = self._robots[name]
            if self._is_just_gone(robot):
                continue
            home = robot.home
            if home in left or home in self._held or not self._floor.is_open(home):
                continue
            del self._rejoining[name]
            robot.removed = robot.paused = robot.charging = False
            robot.cell, robot.target = robot.home, None
            robot.charge = 100.0
            self._faults.repair(robot)
            robot.restart()
            self._held[robot.home] = robot
            self._steps.note_change()

    def _is_just_gone(self, robot: SimulatedRobot) -> bool:
        step = self._removed_steps.get(robot.serial_number, -_AWAY_STEPS)
        return robot.removed and self._steps.now - step < _AWAY_STEPS

    def _put_pallets(self) -> None:
        for cell in [cell for cell in self._floor.waiting if cell not in self._held]:
            del self._floor.waiting[cell]
            self._floor.pallets[cell] = ''
            self._steps.note_change()

    # One step.

    def step(self) -> FleetState:
        """Moves the floor on by one step, and tells what it then looks like."""
        self._steps.now += 1
        if self._floor.waiting:
            self._put_pallets()
        if self._rejoining:
            self._rejoin()
        self._faults.happen()
        released = self._take_orders()
        active = [robot for robot in self._robots.values() if not robot.removed]
        for robot in active:
            if robot.work and robot.target is None:
                self._actions.work(robot)
        departing = self._departing(released)
        for robot in active:
            if robot.target is not None:
                self._drive_on(robot)
            else:
                self._rest(robot)
        for robot, target in departing:
            self._depart(robot, target)
        for robot in active:
            if robot.deaf and robot.dirty:
                self._steps.is_kept_old = True
        self._steps.shown = self._steps.now
        heard = tuple([robot.state() for robot in active if not robot.deaf])
        return FleetState(self._steps.now, heard, self._memory())

    def _take_orders(self) -> dict[SimulatedRobot, Cell]:
        """Gives each robot its order; returns where they may go."""
        orders, self._orders = self._orders, None
        released: dict[SimulatedRobot, Cell] = {}
        # Planned on a floor that has changed since, they could not be obeyed safely.
        if orders is None or orders.step < self._steps.changed:
            return released
        for order in orders.orders:
            robot = self._robots.get(order.serial_number)
            if robot is None or robot.removed or robot.deaf:
                continue
            if refusal := robot.refusal(order) or self._faults.refusal(robot, order):
                robot.refuse(order, refusal)
            elif (target := robot.take(order)) is not None:
                released[robot] = target
        return released

    def _departing(
        self, released: dict[SimulatedRobot, Cell]
    ) -> list[tuple[SimulatedRobot, Cell]]:
        """The robots that begin to drive in this step, and where."""
        wishes: dict[Cell, Cell] = {}
        taken = set(released.values())
        swift = set()
        for robot, wish in released.items():
            if robot.stands or robot.work or robot.busy_step == self._steps.now:
                continue
            target = wish
            if robot.faults:
                target = self._faults.strayed(robot, wish, self._held, taken)
            if is_next(robot.cell, target) and self._floor.is_open(target):
                wishes[robot.cell] = target
                if robot.steps_per_cell == 1:
                    swift.add(robot.cell)
        return [(self._held[cell], wishes[cell]) for cell in granted(wishes, swift, self._held)]

    def _depart(self, robot: SimulatedRobot, target: Cell) -> None:
        # A follower may have come to hold the cell already.
        if self._held.get(robot.cell) is robot:
            del self._held[robot.cell]
        robot.depart(target)
        for cell in robot.cells:
            self._held[cell] = robot
        self._steps.changed = self._steps.now

    def _drive_on(self, robot: SimulatedRobot) -> None:
        if robot.stands:
            self._rest(robot)
            return
        behind = robot.cell
        robot.go_on()
        if robot.target is None:
            del self._held[behind]
            self._steps.changed = self._steps.now

    def _rest(self, robot: SimulatedRobot) -> None:
        battery = robot.kind.battery
        if not robot.charging:
            if robot.charge:
                robot.drain(battery.per_idle_step)
            return
        robot.charge = min(100.0, robot.charge + battery.charge_per_step)

    # Memory.

    def _memory(self) -> dict[str, str]:
        if self._steps.is_kept_old:
            self._steps.is_kept_old = False
            robots = self._robots.values()
            kept = _Kept(
                faults={
                    robot.serial_number: dict(robot.faults) for robot in robots if robot.faults
                },
                removed=[robot.serial_number for robot in robots if robot.removed],
                rejoining=list(self._rejoining),
                silent={
                    robot.serial_number: robot.state()
                    for robot in robots
                    if robot.deaf and not robot.removed
                },
                commands=list(self._commands),
            )
            self._kept = {'fleet': msgspec.json.encode(kept).decode(), 'floor': self._floor.text()}
        return self._kept

    def restore(self, report: FleetReport) -> None:
        """Goes on where a fleet was that the Monitor has reported of, after the process ended.

        Actions that were running are to be ordered again, under the same ids. The steps go on at
        a later number, so that nothing that was planned before can be mistaken for new.
        """
        kept = msgspec.json.decode(report.floor.get('fleet') or '{}', type=_Kept)
        self._floor.read(report.floor.get('floor', ''))
        self._rejoining = dict.fromkeys(kept.rejoining)
        self._commands = dict.fromkeys(kept.commands)
        # Of a silent robot the Monitor knows only what it has last heard.
        states = {robot.serial_number: robot.state for robot in report.robots} | kept.silent
        for name, robot in self._robots.items():
            robot.faults = dict(kept.faults.get(name, {}))
            robot.removed = name in kept.removed
            if name in states and not robot.removed:
                robot.resume(states[name])
        self._held = {
            cell: robot
            for robot in self._robots.values()
            if not robot.removed
            for cell in robot.cells
        }
        self._steps.now = self._steps.shown = report.step + _RESTART_STEPS
        self._schedule.start_at(self._steps.now)
        self._steps.note_change()


def _remember(ids: dict[str, None], new: str) -> None:
    ids[new] = None
    if len(ids) > _COMMANDS:
        del ids[next(iter(ids))]
