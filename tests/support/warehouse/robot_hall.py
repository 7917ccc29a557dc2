"""A hall with robots in it, and an organizer of their tasks."""

from typing import Any, Self

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.site import Product, RobotPlace, Site
from ros2_kafka_warehouse.domain.task_organizer import TaskOrganizer
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import Blocked, FleetReport, RobotReport
from ros2_kafka_warehouse.messages.orders import OpenOrders, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    Error,
    FleetState,
    Load,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments, Costs, Task, TaskStatus

PROFILES = ExecutionProfiles(
    {
        'carrier': RobotType('carrier', max_load_kg=30, sizes=('small',)),
        'hauler': RobotType('hauler', max_load_kg=120, sizes=('small', 'large')),
    }
)
NEAR, FAR, STATION = (2, 0), (5, 2), (0, 0)
SITE = Site(
    'test',
    ('......', '.@@@@.', '......'),
    {'s': STATION, 't': (0, 2)},
    {
        'tea': Product('tea', (FAR, NEAR), 2.0),
        'desk': Product('desk', (FAR,), 50.0, 'large'),
        'pool': Product('pool', (FAR,), 1.0, 'huge'),
    },
    {'r': RobotPlace('r', 'carrier', (0, 0)), 'q': RobotPlace('q', 'hauler', (0, 0))},
)
UNDER_WAY, FINISHED, FAILED = ActionStatus.RUNNING, ActionStatus.FINISHED, ActionStatus.FAILED


def order(*lines: OrderLine, order_id: str = 'a', **more: Any) -> Order:
    lines = lines or (OrderLine('1', 'tea', 3),)
    return Order(order_id, more.pop('update', 0), more.pop('station', 's'), lines, 1.0, **more)


class Hall:
    """An organizer, and what its peers tell it."""

    def __init__(self, *orders: Order) -> None:
        self.organizer = TaskOrganizer(SITE)
        self.step = 0
        self.robots: dict[str, RobotState] = {}
        self.gone: dict[str, RobotState] = {}
        self.gave_up: set[str] = set()
        self.removed: set[str] = set()
        self.costs: dict[str, str] | None = None
        self.assigned: dict[str, str] = {}
        self.blocked: tuple[Cell, ...] = ()
        for name in ('r', 'q'):
            self.robot(name)
        self.orders(*(orders or (order(),)))

    def begun(self) -> Self:
        """The same, which the organizer has seen once."""
        self.now()
        return self

    def orders(self, *orders: Order) -> None:
        self.organizer.take(OpenOrders(orders))

    def robot(
        self,
        name: str,
        *actions: tuple[str, ActionStatus, str],
        load: str = '',
        cell: Cell = (3, 0),
        errors: tuple[Error, ...] = (),
    ) -> None:
        states = tuple(
            ActionState(action_id, action_id.rpartition(':')[2], status, result)
            for action_id, status, result in actions
        )
        self.gone.pop(name, None)
        self.robots[name] = RobotState(
            1,
            name,
            'carrier' if name == 'r' else 'hauler',
            node_id(cell),
            Position(0.0, 0.0),
            PowerSupply(90.0),
            action_states=states,
            loads=(Load(load),) if load else (),
            errors=errors,
        )

    def silence(self, name: str) -> None:
        self.gone[name] = self.robots.pop(name)

    def now(self, steps: int = 1) -> Task:
        """The one task, after some steps."""
        self.go_on(steps)
        return self.organizer.tasks().tasks[0]

    def go_on(self, steps: int) -> None:
        for _ in range(steps):
            self.step += 1
            reports = [
                RobotReport(
                    name,
                    state,
                    0.0,
                    keeps_task=name not in self.gave_up,
                    failure='REMOVED' if name in self.removed else '',
                )
                for name, state in (self.robots | self.gone).items()
            ]
            blocked = tuple(Blocked(cell, 'pallet') for cell in self.blocked)
            self.organizer.follow(
                FleetState(self.step, tuple(self.robots.values())),
                FleetReport(self.step, tuple(reports), blocked),
                None if self.costs is None else Costs(self.step, infeasible=self.costs),
                Assignments(
                    self.step,
                    tuple(Assignment(name, (task,)) for name, task in self.assigned.items()),
                ),
                PROFILES,
            )

    def restart(self, *orders: Order) -> None:
        self.organizer = TaskOrganizer(SITE)
        self.orders(*(orders or (order(),)))


def carried(robot: str = 'r') -> Hall:
    hall = Hall()
    hall.now()
    hall.robot(robot, ('a/1#0:pick', FINISHED, ''), load='a/1')
    assert hall.now().status is TaskStatus.CARRIED
    return hall
