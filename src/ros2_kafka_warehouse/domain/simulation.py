"""The whole warehouse in one loop: the modules that also run as ROS 2 nodes, without ROS or clock.

Each step of the floor the modules take their turns, as they would when messages come in: the
monitor judges the newest state, the task organizer and the orders follow, costs, assignments and
the next step of the plan are made. The same seed gives the same run, byte by byte.
"""

from collections.abc import Callable, Iterable
from random import Random
from typing import Any, Final

from ros2_kafka_warehouse.domain.cost_estimator import CostEstimator
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.faults import FaultPlan
from ros2_kafka_warehouse.domain.kpis import Kpis
from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.domain.order_plan import OrderPlan
from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.domain.path_planner import PathPlanner
from ros2_kafka_warehouse.domain.repairs import Repairs
from ros2_kafka_warehouse.domain.robot_failure_profile import RobotFailureProfile
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.domain.simulation_result import Ends, Result
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.domain.task_allocator import TaskAllocator
from ros2_kafka_warehouse.domain.task_organizer import TaskOrganizer
from ros2_kafka_warehouse.domain.trace_line import trace_line
from ros2_kafka_warehouse.domain.validator import Validator
from ros2_kafka_warehouse.messages.monitor import (
    FailureEvent,
    FleetReport,
    OperatorCommand,
    RobotReport,
)
from ros2_kafka_warehouse.messages.orders import OpenOrders, OrderEvent, OrderRequest
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.messages.tasks import Assignments, Costs, Tasks

MODULES: Final = (
    'orders',
    'task_organizer',
    'cost_estimator',
    'task_allocator',
    'path_planner',
    'monitor',
    'robots',
    'validator',
)

LOOK_AGAIN_STEPS: Final = 8  # costs and assignments are made anew, though nothing has changed


class Simulation:
    """A warehouse, step by step.

    Args:
        site: The site.
        profiles: What the robots can do, and what is done about failures.
        failure_profile: Which evidence means which failure.
        seed: Of all chance in it.
        orders: Which orders come.
        faults: Which faults happen.
        repair_s: Mean of the time in which a person repairs a robot and lets it rejoin; None:
            nobody does.
        lateness: Share of the turns that a module misses: it sees what happened, and answers, a
            step late. As over ROS, where messages take their time.
    """

    def __init__(
        self,
        site: Site,
        profiles: ExecutionProfiles,
        failure_profile: RobotFailureProfile,
        *,
        seed: int = 0,
        orders: OrderPlan = OrderPlan(),  # noqa: B008 - values that nobody can change
        faults: FaultPlan = FaultPlan(),  # noqa: B008
        repair_s: float | None = 120.0,
        lateness: float = 0.0,
    ) -> None:
        self.site = site
        self.profiles = profiles
        self.failure_profile = failure_profile
        self.seed = seed
        self.fleet = Fleet(site, profiles, seed, faults)
        self.desk = OrderDesk(site)
        self.organizer = TaskOrganizer(site)
        self.estimator = CostEstimator(site)
        self.allocator = TaskAllocator(site)
        self.planner = PathPlanner(site, seed, horizon=0)
        self.monitor = Monitor(site)
        self.validator = Validator(site, profiles)
        self.repairs = Repairs(repair_s, seed) if repair_s is not None else None
        self.kpis = Kpis(site.step_s)
        self.now_s = 0.0
        self.steps = 0
        # What the modules have said last.
        self.state = FleetState(0)
        self.report = FleetReport(0)
        self.tasks = Tasks(0)
        self.costs = Costs(0)
        self.assignments = Assignments(0)
        self.open_orders = OpenOrders()
        self.requests: list[OrderRequest] = []
        self.events: list[OrderEvent] = []
        self.failures: list[FailureEvent] = []
        # Chance that can be repeated is no secret.
        self._due = orders.requests(site, profiles, Random(seed))  # noqa: S311
        self._next = next(self._due, None)
        self._delays = Random(seed + 1)  # noqa: S311
        self._lateness = lateness
        self._inbox: list[OrderRequest] = []
        self._states: dict[str, list[FleetState]] = {
            'monitor': [],
            'task_organizer': [],
            'path_planner': [],
        }
        self._commands: list[OperatorCommand] = []
        self._looked_at: tuple[object, ...] = ()
        self._looked_step = 0
        self._new_events = 0
        self._new_failures = 0
        self._ends = Ends()

    # Running

    def run(
        self,
        steps: int,
        *,
        until_done: bool = False,
        each: Callable[['Simulation'], None] | None = None,
    ) -> Result:
        """Take so many steps.

        Args:
            steps: At most.
            until_done: Stop when all orders that will come have ended.
            each: Is called after each step.
        """
        for _ in range(steps):
            self.step()
            if each is not None:
                each(self)
            if until_done and self.is_done:
                break
        return self.result()

    @property
    def is_done(self) -> bool:
        """Whether all orders that will come have ended."""
        return self._next is None and not self._inbox and not self.open_orders.orders

    def step(self) -> None:
        """Let the floor move on by one step, and each module have its turn."""
        self.steps += 1
        self.now_s = self.steps * self.site.step_s
        self._new_events, self._new_failures = len(self.events), len(self.failures)
        self._take_requests()
        self._operate()
        self._move()
        late = self._late()
        if 'monitor' not in late:
            self._monitor()
        if 'task_organizer' not in late:
            self._organize()
        if 'orders' not in late:
            self._follow_orders()
        if 'cost_estimator' not in late:
            self._allocate()
        if 'path_planner' not in late:
            self._plan_paths()
        self._watch()

    def order(self, request: OrderRequest) -> None:
        """Send an order, which comes with the next step."""
        self._inbox.append(request)

    def command(self, command: str, robot: str = '', **more: Any) -> None:
        """Order what an operator can order, with the next step; see `OperatorCommand`."""
        command_id = f'command-{self.steps}-{len(self._commands)}'
        self._commands.append(OperatorCommand(command_id, command, robot, **more))

    def restart(self, module: str) -> None:
        """Kill a module and start it again: it knows only what its peers and Kafka tell it."""
        if module == 'orders':
            self.desk = OrderDesk(self.site)
            self._say_orders(self.desk.restore(self.requests, self.events, self.now_s))
        elif module == 'task_organizer':
            self.organizer = TaskOrganizer(self.site)
        elif module == 'cost_estimator':
            self.estimator = CostEstimator(self.site)
        elif module == 'task_allocator':
            self.allocator = TaskAllocator(self.site)
        elif module == 'path_planner':
            self.planner = PathPlanner(self.site, self.seed, horizon=0)
        elif module == 'monitor':
            self.monitor = Monitor(self.site)
            self.monitor.restore(self.report)
        elif module == 'robots':
            self.fleet = Fleet(self.site, self.profiles, self.seed)
            self.fleet.restore(self.report)
        else:
            self.validator = Validator(self.site, self.profiles)
            self.validator.know(self.tasks)
            self.validator.expect(self.open_orders)

    def result(self) -> Result:
        """How it stands."""
        open_ids = tuple(order.order_id for order in self.open_orders.orders)
        known = {*open_ids, *self._ends.ended, *(order.order_id for order in self._inbox)}
        lost = [order.order_id for order in self.requests if order.order_id not in known]
        return Result(
            steps=self.steps,
            now_s=self.now_s,
            sent=len(self.requests),
            ended=dict(self._ends.ended),
            open=open_ids,
            lost=tuple(lost),
            doubled=tuple(self._ends.doubled),
            violations=self.validator.finish(),
            kpis=self.kpis.view(self.now_s, self.open_orders.orders),
        )

    def line(self) -> bytes:
        """What happened in the last step, as JSON: where the robots are, and the events."""
        return trace_line(
            self.state,
            self.report,
            self.events[self._new_events :],
            self.failures[self._new_failures :],
        )

    # The turns of the modules

    def _late(self) -> frozenset[str]:
        if not self._lateness:
            return frozenset()
        return frozenset(name for name in MODULES if self._delays.random() < self._lateness)

    def _take_requests(self) -> None:
        while self._next is not None and self._next[0] <= self.now_s:
            self._inbox.append(self._next[1])
            self._next = next(self._due, None)
        while self._inbox and not self.desk.is_full:
            request = self._inbox.pop(0)
            self.requests.append(request)
            self._say_orders(self.desk.receive(request, self.now_s))
            self._set_orders()

    def _say_orders(self, events: Iterable[OrderEvent]) -> None:
        for event in events:
            self.events.append(event)
            self.kpis.take_event(event)
            self._ends.take(event)

    def _set_orders(self) -> None:
        self.open_orders = self.desk.open()
        self.validator.expect(self.open_orders)

    def _operate(self) -> None:
        if self.repairs is not None:
            self._commands += self.repairs.commands(self.report, self.now_s)
        commands, self._commands = self._commands, []
        for command in commands:
            self.fleet.operate(command)
            self.monitor.operate(command, self.now_s)

    def _move(self) -> None:
        self.state = self.fleet.step()
        for states in self._states.values():
            states.append(self.state)

    def _new_states(self, module: str) -> list[FleetState]:
        states = self._states[module]
        self._states[module] = []
        return states

    def _monitor(self) -> None:
        for state in self._new_states('monitor'):
            self.monitor.observe(state, self.now_s)
        self.monitor.know(self.tasks)
        judgement = self.monitor.judge(self.now_s, self.profiles, self.failure_profile)
        self.report = judgement.report
        for event in judgement.events:
            self.failures.append(event)
            self.kpis.take_failure(event)
            if self.repairs is not None:
                self.repairs.take(event)
        if judgement.actions.actions:
            self.fleet.act(judgement.actions)

    def _organize(self) -> None:
        self.organizer.take(self.open_orders)
        for state in self._new_states('task_organizer'):
            self.organizer.follow(state, self.report, self.costs, self.assignments, self.profiles)
        self.tasks = self.organizer.tasks()

    def _follow_orders(self) -> None:
        events = self.desk.follow(self.tasks, self.assignments, self.now_s)
        if events:
            self._say_orders(events)
        self._set_orders()

    def _allocate(self) -> None:
        """Costs and assignments, when something has changed that they depend on."""
        looked_at = (self.tasks.tasks, *_what_counts(self.report))
        again = self.steps >= self._looked_step + LOOK_AGAIN_STEPS
        if not again and looked_at == self._looked_at:
            return
        self._looked_at = looked_at
        self._looked_step = self.steps
        self.costs = self.estimator.estimate(self.tasks, self.report, self.profiles, self.now_s)
        self.assignments = self.allocator.allocate(
            self.tasks, self.report, self.costs, self.profiles, self.now_s
        )

    def _plan_paths(self) -> None:
        for state in self._new_states('path_planner')[:-1]:
            self.planner.see(state)
        orders = self.planner.plan(
            self.state, self.tasks, self.assignments, self.report, self.profiles
        )
        self.fleet.order(orders)
        self.monitor.expect(orders)

    def _watch(self) -> None:
        """The onlookers: the validator, whose word the monitor hears, and the key figures.

        The validator knows the tasks of the step before, as over ROS: a load may be set down in
        the step in which its task leaves.
        """
        self.validator.hear(self.report)
        report = self.validator.check(self.state, self.now_s)
        if report.violations:
            self.monitor.check(report)
        self.validator.know(self.tasks)
        self.kpis.take_report(self.report)
        self.kpis.take_assignments(self.assignments)
        self.kpis.take_state(self.state)


def _what_counts(report: FleetReport) -> tuple[object, ...]:
    """What of a report makes another allocation: not where the robots are."""
    return (
        [_state_of(robot) for robot in report.robots],
        report.blocked,
        report.faulty_chargers,
        report.halted,
    )


def _state_of(robot: RobotReport) -> tuple[object, ...]:
    return (
        robot.commissioned,
        robot.can_move,
        robot.keeps_task,
        robot.charge,
        robot.failure,
        robot.obstacle,
        robot.state.power_supply.charging,
    )
