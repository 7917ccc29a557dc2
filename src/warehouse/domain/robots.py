"""The simulated fleet: robots on a floor, which do what they are ordered and never meet.

One `step` is one tick of the floor. The Fleet knows what is physically true; its states tell only
what robots would tell. Whatever comes in as orders, no two robots hold a cell, and none drives
through a wall: each has a scanner that stops it.
"""

from typing import Final

import msgspec

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.faults import (
    CRASH_STEPS,
    ORDER_ERRORS,
    REFUSALS,
    FaultPlan,
    Schedule,
)
from warehouse.domain.floor import Floor, granted, is_next
from warehouse.domain.simulated_robot import SimulatedRobot, Work
from warehouse.domain.site import Site
from warehouse.messages import (
    Action,
    ActionStatus,
    Cell,
    Error,
    ErrorLevel,
    FleetOrders,
    FleetReport,
    FleetState,
    InstantAction,
    InstantActions,
    Load,
    OperatorCommand,
    RobotState,
)

__all__ = ['Fleet']

_AWAY_STEPS: Final = 4  # at least, between taking a robot off the floor and putting it back
_RESTART_STEPS: Final = 10  # between the last step that others may have seen and the next one
_COMMANDS: Final = 50  # ids of commands that are remembered, to obey each once

_ORDER_TEXTS: Final = {
    'PICK_FAILED': 'the gripper did not get the load',
    'LOAD_MISSING': 'the load is not there',
    'OVERWEIGHT': 'the load is too heavy',
    'MISFIT': 'the load does not fit on the robot',
}


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
        self._site = site
        self._floor = Floor(site)
        self._chargers = frozenset(site.chargers)
        self._robots = {
            name: SimulatedRobot(place, profiles.robot_types[place.robot_type], site.cell_m)
            for name, place in site.robots.items()
        }
        self._held = {robot.cell: robot for robot in self._robots.values()}
        self._schedule = Schedule(faults, tuple(site.robots), seed)
        self._step = 0
        self._shown = 0
        self._changed = 0  # the step that first shows the newest change of the floor
        self._orders: FleetOrders | None = None
        self._rejoining: dict[str, None] = {}
        self._removed_steps: dict[str, int] = {}
        self._commands: dict[str, None] = {}
        self._instant_actions: dict[str, None] = {}
        self._kept: dict[str, str] = {}
        self._kept_is_old = False

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
        self._note_change()
        robot = self._robots.get(command.robot)
        match command.command:
            case 'failRobot' if robot is not None:
                self._break(robot, command.failure or 'UNKNOWN')
            case 'repairRobot' if robot is not None:
                self._repair(robot)
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

    def _note_change(self) -> None:
        """What was planned on the states so far is void."""
        self._changed = self._shown + 1
        self._kept_is_old = True

    # Faults.

    def _break(self, robot: SimulatedRobot, code: str) -> None:
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
                robot.faults[code] = self._step + CRASH_STEPS
            case 'CHARGER_FAULT' if robot.charging:
                self._break_charger(robot)
            case _:
                pass
        robot.settle()
        self._note_change()

    def _drop_dropped(self, robot: SimulatedRobot) -> None:
        """Lets the load of a robot with LOAD_DROPPED slide off, once there is one."""
        if robot.load is not None and robot.faults.get('LOAD_DROPPED') == 0:
            self._floor.put(robot.load, robot.cells[-1], to_station=False)
            robot.load = None
            robot.faults['LOAD_DROPPED'] = 1
            robot.settle()
            self._note_change()

    def _break_charger(self, robot: SimulatedRobot) -> None:
        self._floor.chargers[robot.cell] = robot.serial_number
        robot.charging = False
        self._end_fault(robot, 'CHARGER_FAULT')

    def _end_fault(self, robot: SimulatedRobot, code: str) -> None:
        del robot.faults[code]
        robot.settle()
        self._kept_is_old = True

    def _repair(self, robot: SimulatedRobot) -> None:
        self._floor.repair(robot.serial_number)
        robot.faults.clear()
        robot.order_errors.clear()
        robot.give_up_retries()
        battery = robot.kind.battery
        if robot.charge < battery.low:
            robot.charge = battery.target
        robot.settle()

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
        self._removed_steps[robot.serial_number] = self._step

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
            self._repair(robot)
            robot.restart()
            self._held[robot.home] = robot
            self._note_change()

    def _is_just_gone(self, robot: SimulatedRobot) -> bool:
        step = self._removed_steps.get(robot.serial_number, -_AWAY_STEPS)
        return robot.removed and self._step - step < _AWAY_STEPS

    def _put_pallets(self) -> None:
        for cell in [cell for cell in self._floor.waiting if cell not in self._held]:
            del self._floor.waiting[cell]
            self._floor.pallets[cell] = ''
            self._note_change()

    def _happen(self) -> None:
        """The faults that are due, and what goes on with those that are there."""
        for name, code in self._schedule.due(self._step):
            robot = self._robots.get(name)
            if robot is not None and not robot.faults:
                self._break(robot, code)
        for robot in self._robots.values():
            if not robot.faults or robot.removed:
                continue
            self._drop_dropped(robot)
            if robot.faults.get('SOFTWARE_CRASH', self._step) < self._step:
                robot.restart()
                self._end_fault(robot, 'SOFTWARE_CRASH')

    # One step.

    def step(self, now_s: float = 0.0) -> FleetState:  # noqa: ARG002 - steps are its only clock
        """Moves the floor on by one step, and tells what it then looks like."""
        self._step += 1
        if self._floor.waiting:
            self._put_pallets()
        if self._rejoining:
            self._rejoin()
        self._happen()
        released = self._take_orders()
        active = [robot for robot in self._robots.values() if not robot.removed]
        for robot in active:
            if robot.work and robot.target is None:
                self._work(robot)
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
                self._kept_is_old = True
        self._shown = self._step
        heard = tuple([robot.state() for robot in active if not robot.deaf])
        return FleetState(self._step, heard, self._memory())

    def _take_orders(self) -> dict[SimulatedRobot, Cell]:
        """Gives each robot its order; returns where they may go."""
        orders, self._orders = self._orders, None
        released: dict[SimulatedRobot, Cell] = {}
        # Planned on a floor that has changed since, they could not be obeyed safely.
        if orders is None or orders.step < self._changed:
            return released
        for order in orders.orders:
            robot = self._robots.get(order.serial_number)
            if robot is None or robot.removed or robot.deaf:
                continue
            refusal = robot.refusal(order)
            if not refusal and robot.faults.get('ORDER_REJECTED') and order != robot.order:
                refusal = 'VALIDATION_FAILURE'
                self._count_refusal(robot)
            if refusal:
                robot.refuse(order, refusal)
            elif (target := robot.take(order)) is not None:
                released[robot] = target
        return released

    def _count_refusal(self, robot: SimulatedRobot) -> None:
        robot.faults['ORDER_REJECTED'] -= 1
        if not robot.faults['ORDER_REJECTED']:
            self._end_fault(robot, 'ORDER_REJECTED')

    def _departing(
        self, released: dict[SimulatedRobot, Cell]
    ) -> list[tuple[SimulatedRobot, Cell]]:
        """The robots that begin to drive in this step, and where."""
        wishes: dict[Cell, Cell] = {}
        swift = set()
        for robot, wish in released.items():
            if robot.stands or robot.work or robot.busy_step == self._step:
                continue
            target = self._strayed(robot, wish, released) if robot.faults else wish
            if is_next(robot.cell, target) and self._floor.is_open(target):
                wishes[robot.cell] = target
                if robot.steps_per_cell == 1:
                    swift.add(robot.cell)
        return [(self._held[cell], wishes[cell]) for cell in granted(wishes, swift, self._held)]

    def _strayed(
        self, robot: SimulatedRobot, target: Cell, released: dict[SimulatedRobot, Cell]
    ) -> Cell:
        """Where a robot with faults goes, instead of where it was ordered."""
        if 'PATH_BLOCKED' in robot.faults and target not in self._held:
            self._floor.pallets[target] = robot.serial_number
            self._end_fault(robot, 'PATH_BLOCKED')
            self._note_change()
        if 'OFF_PLAN' in robot.faults:
            column, row = robot.cell
            taken = set(released.values())
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
                if not self._floor.is_open(cell) or cell in self._held or cell in taken:
                    continue
                # One that is silent was last seen where it is, or a cell before: nobody else
                # knows that it has left that.
                if not any(is_next(cell, other) for other in unseen):
                    self._end_fault(robot, 'OFF_PLAN')
                    return cell
        return target

    def _depart(self, robot: SimulatedRobot, target: Cell) -> None:
        # A follower may have come to hold the cell already.
        if self._held.get(robot.cell) is robot:
            del self._held[robot.cell]
        robot.depart(target)
        for cell in robot.cells:
            self._held[cell] = robot
        self._changed = self._step

    def _drive_on(self, robot: SimulatedRobot) -> None:
        if robot.stands:
            self._rest(robot)
            return
        behind = robot.cell
        robot.go_on()
        if robot.target is None:
            del self._held[behind]
            self._changed = self._step

    def _rest(self, robot: SimulatedRobot) -> None:
        battery = robot.kind.battery
        if not robot.charging:
            if robot.charge:
                robot.drain(battery.per_idle_step)
            return
        robot.charge = min(100.0, robot.charge + battery.charge_per_step)

    # Actions.

    def _work(self, robot: SimulatedRobot) -> None:
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
            robot.busy_step = self._step
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
        self._kept_is_old = True
        return ''

    def _pick_fault(self, robot: SimulatedRobot, action: Action) -> str:
        if 'PICK_FAILED' in robot.faults:
            return 'PICK_FAILED'
        product = self._site.products.get(action.product)
        if action.weight_kg > robot.kind.max_load_kg:
            return 'OVERWEIGHT'
        if product is not None and product.size not in robot.kind.sizes:
            return 'MISFIT'
        for code in ('LOAD_MISSING', 'OVERWEIGHT', 'MISFIT'):
            if code in robot.faults:
                self._end_fault(robot, code)
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
        self._kept_is_old = True
        return ''

    def _start_charging(self, robot: SimulatedRobot) -> str:
        if robot.cell not in self._chargers:
            return 'NO_CHARGER'
        if 'CHARGER_FAULT' in robot.faults:
            self._break_charger(robot)
        if robot.cell in self._floor.chargers:
            return 'CHARGER_FAULT'
        robot.charging = True
        return ''

    # Memory.

    def _memory(self) -> dict[str, str]:
        if self._kept_is_old:
            self._kept_is_old = False
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
        self._step = self._shown = report.step + _RESTART_STEPS
        self._schedule.start_at(self._step)
        self._note_change()


def _is_in_reach(cell: Cell, load: Cell) -> bool:
    return cell == load or is_next(cell, load)


def _remember(ids: dict[str, None], new: str) -> None:
    ids[new] = None
    if len(ids) > _COMMANDS:
        del ids[next(iter(ids))]
