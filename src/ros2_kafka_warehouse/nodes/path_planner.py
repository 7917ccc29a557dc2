"""Path Planner: says what every robot may do in the next step, and the ways that it foresees."""

import time
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.path_planner import PathPlanner
from ros2_kafka_warehouse.domain.places import obstacles
from ros2_kafka_warehouse.domain.site import WALL, Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.onlookers import Plans
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.messages.tasks import Assignments, Tasks
from ros2_kafka_warehouse.nodes.node import Module
from ros2_kafka_warehouse.nodes.standard import FRAME, place, ros_name

_FREE: Final = 0
_OCCUPIED: Final = 100


def start(module: Module) -> None:
    """Plan once for each step, when the Monitor has judged the robots."""
    planner = PathPlanner(module.site)
    states = module.queue('/robots/state', FleetState, asks=False)
    tasks = module.newest('/tasks', Tasks, asks=False)
    assignments = module.newest('/assignments', Assignments, asks=False)
    profiles = module.newest('/execution_profiles', ExecutionProfiles, asks=False)
    report = module.newest('/monitor/fleet', FleetReport)
    orders = module.speaker('/robots/orders')
    plans = module.speaker('/path_planner/plans')
    ways, grid = _Ways(module), _Map(module)
    planned = -1

    def plan() -> None:
        nonlocal planned
        came = states.take()
        if not came or came[-1].step == planned:
            return
        for missed in came[:-1]:
            planner.see(missed)
        state = came[-1]
        planned = state.step
        began_s = time.perf_counter()
        orders.say(
            planner.plan(state, tasks.value, assignments.value, report.value, profiles.value)
        )
        took_ms = 1000 * (time.perf_counter() - began_s)
        foreseen = planner.plans(round(took_ms, 3))
        plans.say(foreseen)
        ways.show(foreseen)
        grid.show(obstacles(report.value))

    module.work_on(plan, states, tasks, assignments, profiles, report)


class _Ways:
    """`/<robot>/path` for those who look on."""

    def __init__(self, module: Module) -> None:
        self._cell_m = module.site.cell_m
        self._publishers: dict[str, Any] = {
            name: module.ros_publisher(f'/{ros_name(name)}/path', Path, latched=True)
            for name in module.site.robots
        }
        self._said: dict[str, tuple[Cell, ...]] = {}
        self._clock = module.node.get_clock()

    def show(self, plans: Plans) -> None:
        """Publish the ways that have changed, where somebody looks."""
        ways = {plan.serial_number: plan.path for plan in plans.plans}
        for name, publisher in self._publishers.items():
            if publisher.get_subscription_count() == 0:
                self._said.pop(name, None)  # whoever comes gets the whole way
                continue
            way = ways.get(name, ())
            if self._said.get(name) != way:
                self._said[name] = way
                publisher.publish(self._path(way))

    def _path(self, way: tuple[Cell, ...]) -> Path:
        path = Path()
        path.header.frame_id = FRAME
        path.header.stamp = self._clock.now().to_msg()
        for cell in way:
            pose = PoseStamped()
            pose.header = path.header
            column, row = cell
            place(pose.pose, column * self._cell_m, row * self._cell_m, 0.0)
            path.poses.append(pose)
        return path


class _Map:
    """`/map`: shelves and walls, and what is blocked now."""

    def __init__(self, module: Module) -> None:
        self._publisher = module.ros_publisher('/map', OccupancyGrid, latched=True)
        self._site = module.site
        self._clock = module.node.get_clock()
        self._said: frozenset[Cell] | None = None

    def show(self, blocked: frozenset[Cell]) -> None:
        """Publish the map when what is blocked has changed."""
        if blocked == self._said:
            return
        self._said = blocked
        grid = OccupancyGrid()
        grid.header.frame_id = FRAME
        grid.header.stamp = self._clock.now().to_msg()
        grid.info.resolution = self._site.cell_m
        grid.info.width, grid.info.height = len(self._site.rows[0]), len(self._site.rows)
        grid.info.origin.position.x = grid.info.origin.position.y = -self._site.cell_m / 2
        # In the frame of the site y points down the map, so the first row is row 0 here, too.
        grid.data = _occupied(self._site, blocked)
        self._publisher.publish(grid)


def _occupied(site: Site, blocked: frozenset[Cell]) -> list[int]:
    return [
        _OCCUPIED if mark == WALL or (column, row) in blocked else _FREE
        for row, marks in enumerate(site.rows)
        for column, mark in enumerate(marks)
    ]
