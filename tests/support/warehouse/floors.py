"""A small warehouse for the unit tests, and the messages that its modules see."""

from typing import Any

from ros2_kafka_warehouse.domain.execution_profiles import Battery, ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.simulation_result import Result
from ros2_kafka_warehouse.domain.site import Product, RobotPlace, Site
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.robots import (
    FleetState,
    Load,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Task, Tasks

ROWS = (
    '..........',
    '.e@@ee@@e.',
    '.e@@ee@@e.',
    '..........',
)
TEA, SAFE = (1, 1), (8, 2)  # stock cells
PACKING = (9, 0)
CHARGER = (0, 3)

PROFILES = ExecutionProfiles(
    robot_types={
        'carrier': RobotType('carrier', max_load_kg=30, pick_steps=2, drop_steps=1),
        'hauler': RobotType(
            'hauler',
            max_load_kg=120,
            sizes=('small', 'large'),
            steps_per_cell=2,
            battery=Battery(per_cell=0.1),
        ),
    }
)


def site(**robots: tuple[str, Cell]) -> Site:
    """The floor of `ROWS` with robots: name -> type and home."""
    return Site(
        name='small',
        rows=ROWS,
        stations={'packing': PACKING},
        products={
            'tea': Product('tea', (TEA,), weight_kg=1.0),
            'safe': Product('safe', (SAFE,), weight_kg=80.0, size='large'),
        },
        robots={name: RobotPlace(name, kind, home) for name, (kind, home) in robots.items()},
        chargers=(CHARGER,),
        step_s=1.0,
    )


def state(name: str, cell: Cell, **fields: Any) -> RobotState:
    """The state of a robot that stands on a cell; `loads` as names, `charge` in percent."""
    loads = tuple(Load(load) for load in fields.pop('loads', ()))
    power = PowerSupply(fields.pop('charge', 90.0), fields.pop('charging', False))
    kind = fields.pop('kind', 'carrier')
    position = Position(float(cell[0]), float(cell[1]))
    return RobotState(1, name, kind, node_id(cell), position, power, loads=loads, **fields)


def fleet(*states: RobotState, step: int = 1) -> FleetState:
    """The robots that are heard of at a step."""
    return FleetState(step, states)


def report(*robots: RobotState | RobotReport, step: int = 1, **fields: Any) -> FleetReport:
    """What the Monitor says of robots; states are those of robots that are well."""
    reports = tuple(
        robot if isinstance(robot, RobotReport) else RobotReport(robot.serial_number, robot, 0.0)
        for robot in robots
    )
    return FleetReport(step, reports, **fields)


def task(name: str, **fields: Any) -> Task:
    """A task from the tea to packing, if nothing else is said; `name` as order/line."""
    order, line = name.split('/')
    product = fields.pop('product', 'tea')
    defaults: dict[str, Any] = {
        'weight_kg': 1.0 if product == 'tea' else 80.0,
        'pickup': TEA if product == 'tea' else SAFE,
        'delivery': PACKING,
        'released_s': 0.0,
    }
    return Task(name, order, line, product, **{**defaults, **fields})


def tasks(*several: Task, step: int = 2) -> Tasks:
    """The tasks at a step: later than that of `fleet`, so that they are news to the planner."""
    return Tasks(step, several)


def assert_right(result: Result) -> None:
    """A simulation broke no rule, and each order has ended once."""
    assert result.violations == ()
    assert result.lost == ()
    assert result.doubled == ()
    assert result.open == ()
    assert len(result.ended) == result.sent
