"""A simulated fleet on a small floor, and what tests do with it."""

from collections.abc import Sequence
from typing import Any

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.domain.site import Product, RobotPlace, Site
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import FleetReport, OperatorCommand, RobotReport
from ros2_kafka_warehouse.messages.robots import (
    Action,
    ActionStatus,
    ErrorLevel,
    FleetOrders,
    FleetState,
    InstantAction,
    InstantActions,
    OrderNode,
    RobotOrder,
    RobotState,
)

QUICK = RobotType('quick', max_load_kg=30, sizes=('small',), pick_steps=0, drop_steps=0)
CARRIER = RobotType('carrier', max_load_kg=30, sizes=('small',))
HAULER = RobotType('hauler', max_load_kg=120, sizes=('small', 'large'), steps_per_cell=2)
PROFILES = ExecutionProfiles({kind.name: kind for kind in (QUICK, CARRIER, HAULER)})
ROWS = (
    '......',
    '.@@.e.',
    '......',
)
STATION, STOCK, CHARGER = (0, 0), (4, 1), (0, 2)
PRODUCTS = {
    'tea': Product('tea', (STOCK,), 1.0),
    'desk': Product('desk', (STOCK,), 20.0, 'large'),
}


def site(*robots: tuple[str, Cell]) -> Site:
    places = {
        f'r{number}': RobotPlace(f'r{number}', kind, home)
        for number, (kind, home) in enumerate(robots)
    }
    return Site('test', ROWS, {'s': STATION}, PRODUCTS, places, (CHARGER,))


class Floor:
    """A fleet with a person who orders it, one step at a time."""

    def __init__(self, *robots: tuple[str, Cell], **more: Any) -> None:
        self.site = site(*robots)
        self.fleet = Fleet(self.site, PROFILES, **more)
        self.update = 0
        self.command_id = 0
        self.state = self.fleet.step()

    def step(self, count: int = 1) -> FleetState:
        for _ in range(count):
            self.state = self.fleet.step()
        return self.state

    def go(self, **targets: Cell) -> FleetState:
        """Orders robots to their next cells, for one step."""
        return self.send(*(self.order(name, to=cell) for name, cell in targets.items()))

    def cells_after(self, **targets: Cell) -> dict[str, Cell]:
        """Where all are after orders to these cells."""
        self.go(**targets)
        return self.cells()

    def do(self, name: str, action: Action) -> FleetState:
        return self.send(self.order(name, action=action))

    def send(self, *orders: RobotOrder) -> FleetState:
        self.fleet.order(FleetOrders(self.state.step, orders))
        return self.step()

    def order(
        self,
        name: str,
        *,
        to: Cell | None = None,
        action: Action | None = None,
        order_id: str = 'o',
        update: int | None = None,
        at: Cell | None = None,
    ) -> RobotOrder:
        self.update = self.update + 1 if update is None else update
        start = at or self.fleet._robots[name].cell
        nodes = [OrderNode(node_id(start), 0, actions=(action,) if action else ())]
        if to is not None:
            nodes.append(OrderNode(node_id(to), 2))
        return RobotOrder(name, order_id, self.update, tuple(nodes))

    def command(self, command: str, robot: str = '', **more: Any) -> None:
        self.command_id += 1
        self.fleet.operate(OperatorCommand(f'c{self.command_id}', command, robot, **more))

    def obey(self, command: str, robot: str = '', **more: Any) -> None:
        """A command, and one step that it is obeyed in."""
        self.command(command, robot, **more)
        self.step()

    def act(self, name: str, action_type: str) -> None:
        self.command_id += 1
        actions = (InstantAction(name, f'i{self.command_id}', action_type),)
        self.fleet.act(InstantActions(actions))

    def robot(self, name: str) -> RobotState:
        return next(state for state in self.state.states if state.serial_number == name)

    def cells(self) -> dict[str, Cell]:
        return {state.serial_number: state.cell for state in self.state.states}

    def errors(self, name: str) -> dict[str, ErrorLevel]:
        return {error.error_type: error.error_level for error in self.robot(name).errors}

    def statuses(self, name: str) -> dict[str, tuple[ActionStatus, str]]:
        return {
            state.action_id: (state.action_status, state.result_description)
            for state in self.robot(name).action_states
        }


def pick(task: str = 'a/1', attempt: int = 0, source: Cell | None = None) -> Action:
    return Action(f'{task}#{attempt}:pick', 'pick', task, 'tea', 1.0, source)


def drop(task: str = 'a/1', attempt: int = 0) -> Action:
    return Action(f'{task}#{attempt}:drop', 'drop', task, 'tea', 1.0)


def loaded(kind: str = 'quick', *others: tuple[str, Cell]) -> Floor:
    """A floor on which r0 has just picked the load of task a/1."""
    floor = Floor((kind, STOCK), *others)
    floor.do('r0', pick())
    floor.step(3)
    assert [load.load_id for load in floor.robot('r0').loads] == ['a/1']
    return floor


def report_of(state: FleetState, silent: Sequence[RobotState] = ()) -> FleetReport:
    robots = (*state.states, *silent)
    return FleetReport(
        state.step,
        tuple(RobotReport(robot.serial_number, robot, 0.0) for robot in robots),
        floor=state.floor,
    )
