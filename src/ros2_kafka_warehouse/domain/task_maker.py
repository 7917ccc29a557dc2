"""What becomes a task, and who can do it, by the site alone."""

from collections.abc import Iterable
from typing import Final

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.grid import Distances, Grid
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.orders import LineStatus, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import Load, RobotState
from ros2_kafka_warehouse.messages.tasks import Task, TaskStatus

_LINE_ENDS: Final = {
    LineStatus.DELIVERED: TaskStatus.DELIVERED,
    LineStatus.FAILED: TaskStatus.FAILED,
    LineStatus.CANCELLED: TaskStatus.CANCELLED,
}


class TaskMaker:
    """Makes the tasks of a site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._types = {robot.robot_type for robot in site.robots.values()}
        self._distances = Distances(Grid(site.rows), targets=tuple(site.stations.values()))

    def new_task(self, order: Order, line: OrderLine, task_id: str) -> Task:
        """The task of a line."""
        product = self._site.products[line.product]
        delivery = self._site.stations[order.station]
        return Task(
            task_id=task_id,
            order_id=order.order_id,
            line_id=line.line_id,
            product=line.product,
            weight_kg=round(line.quantity * product.weight_kg, 3),
            pickup=line.place or self.nearest(product.cells, delivery),
            delivery=delivery,
            released_s=order.released_s,
            status=_LINE_ENDS.get(line.status, TaskStatus.OPEN),
            stranded=line.place is not None,
            attempt=line.attempt,
            priority=order.priority,
            due_s=order.due_s,
            quantity=line.quantity,
        )

    def orphan(self, load: Load, state: RobotState) -> Task:
        """The task of a load that a robot has and no open order knows: it goes to a station."""
        order_id, _, line_id = load.load_id.rpartition('/')
        stations = self._site.stations.values()
        delivery = min(stations, key=lambda cell: self._distances.steps(state.cell, cell))
        return Task(
            task_id=load.load_id,
            order_id=order_id,
            line_id=line_id,
            product=load.load_type,
            weight_kg=load.weight,
            pickup=state.cell,
            delivery=delivery,
            released_s=0.0,
            status=TaskStatus.CANCELLED,
            reason='no open order knows its load',
        )

    def nearest(self, cells: Iterable[Cell], delivery: Cell) -> Cell:
        """The cell from which a delivery is not far."""
        return min(cells, key=lambda cell: self._distances.steps(cell, delivery))

    def stock(self, task: Task) -> tuple[Cell, ...]:
        """The stock cells of its product."""
        product = self._site.products.get(task.product)
        return () if product is None else product.cells

    def able(self, task: Task, profiles: ExecutionProfiles) -> set[str]:
        """The types of robots on this site that can carry a load, by their profiles."""
        product = self._site.products.get(task.product)
        kinds = (kind for kind in profiles.robot_types.values() if kind.name in self._types)
        return {
            kind.name
            for kind in kinds
            if task.weight_kg <= kind.max_load_kg
            and (product is None or product.size in kind.sizes)
        }

    def unable(self, task: Task) -> str:
        """Why no robot of this site can carry a load, in words."""
        product = self._site.products.get(task.product)
        size = product.size if product is not None else 'unknown'
        return f'no type of robot here can carry {task.weight_kg:g} kg of size {size}'
