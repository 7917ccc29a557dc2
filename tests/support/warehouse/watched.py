"""A Monitor that watches a few robots, and what it is told and says."""

from typing import Any

import msgspec

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.domain.robot_failure_profile import read_failure_profile
from ros2_kafka_warehouse.domain.site import RobotPlace, Site
from ros2_kafka_warehouse.messages.message import Cell, node_id
from ros2_kafka_warehouse.messages.monitor import (
    FailureEvent,
    FleetReport,
    OperatorCommand,
    RobotReport,
)
from ros2_kafka_warehouse.messages.robots import (
    Error,
    ErrorLevel,
    FleetOrders,
    FleetState,
    InstantAction,
    OrderNode,
    Position,
    PowerSupply,
    RobotOrder,
    RobotState,
)
from ros2_kafka_warehouse.messages.tasks import Task, TaskStatus

PROFILES = read_execution_profiles()
TABLE = read_failure_profile()
CHARGER = (9, 3)
SITE = Site(
    'floor',
    ('..........',) * 4,
    stations={'door': (9, 0)},
    products={},
    robots={name: RobotPlace(name, 'carrier', (0, row)) for row, name in enumerate('ab')},
    chargers=(CHARGER,),
    step_s=0.5,
)


class Watched:
    """A Monitor, the states of two robots that stand until they are told otherwise, and time."""

    def __init__(self) -> None:
        self.monitor = Monitor(SITE)
        self.step = 0
        self.states = {
            place.serial_number: RobotState(
                1,
                place.serial_number,
                place.robot_type,
                node_id(place.home),
                Position(0.5, 0.5),
                PowerSupply(100.0),
            )
            for place in SITE.robots.values()
        }
        self.absent: set[str] = set()
        self.events: list[FailureEvent] = []
        self.actions: list[InstantAction] = []
        self.report = FleetReport(0)
        self.wait()

    @property
    def now_s(self) -> float:
        return self.step * SITE.step_s

    def change(self, name: str = 'a', **fields: Any) -> None:
        """The robot's next state is another one."""
        state = self.states[name]
        self.states[name] = msgspec.structs.replace(state, header_id=state.header_id + 1, **fields)

    def say(self, error_type: str = '', level: ErrorLevel = ErrorLevel.FATAL) -> None:
        """The robot reports an error, or none any more."""
        self.change(errors=(Error(error_type, level),) if error_type else ())

    def wait(self, steps: int = 1) -> list[str]:
        """Let steps pass; returns what happened: `FailureDetected PATH_BLOCKED`, ..."""
        before = len(self.events)
        for _ in range(steps):
            self.step += 1
            states = tuple(state for name, state in self.states.items() if name not in self.absent)
            self.monitor.observe(FleetState(self.step, states), self.now_s)
            self.judge()
        return [f'{event.event} {event.code}' for event in self.events[before:]]

    def judge(self) -> None:
        judgement = self.monitor.judge(self.now_s, PROFILES, TABLE)
        self.report = judgement.report
        self.events += judgement.events
        self.actions += judgement.actions.actions

    def order(self, *cells: Cell, name: str = 'a', update: int = 0) -> None:
        """Order the robot to drive, and have it accept the order."""
        self.expect(*cells, name=name, update=update)
        self.change(name, order_id='task#0', order_update_id=update)

    def expect(self, *cells: Cell, name: str = 'a', update: int = 0) -> None:
        nodes = tuple(
            OrderNode(node_id(cell), 2 * number, number < 2) for number, cell in enumerate(cells)
        )
        orders = (RobotOrder(name, 'task#0', update, nodes),) if cells else ()
        self.monitor.expect(FleetOrders(self.step, orders))

    def operate(self, command: str, robot: str = 'a', **more: Any) -> None:
        number = f'{self.step}-{command}-{robot}'
        self.monitor.operate(OperatorCommand(number, command, robot, **more), self.now_s)

    def robot(self, name: str = 'a') -> RobotReport:
        return next(one for one in self.report.robots if one.serial_number == name)

    def restart(self) -> None:
        """Kill the Monitor and start it again from what its last report says over a topic."""
        self.monitor = Monitor(SITE)
        self.monitor.restore(decode(encode(self.report), FleetReport))

    def told(self, name: str = 'a') -> list[str]:
        return [one.action_type for one in self.actions if one.serial_number == name]


def a_task(**fields: Any) -> Task:
    task = Task('o/1', 'o', '1', 'tea', 1.0, (5, 0), (9, 0), 0.0, TaskStatus.CARRIED, 'a')
    return msgspec.structs.replace(task, **fields)


def block_ahead(watched: Watched, update: int = 1) -> list[str]:
    """Have robot a stand before (1, 0), to which it is ordered, until that cell is blocked."""
    said = []
    for number in range(9):
        watched.order((0, 0), (1, 0), update=update + number)
        said += watched.wait()
    return said
