"""Where robots cannot drive, and from where a load can be picked: what several modules ask."""

from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.tasks import Task


def obstacles(report: FleetReport) -> frozenset[Cell]:
    """The cells that no robot can enter: those that are blocked, and robots that failed."""
    blocked = {blocked.cell for blocked in report.blocked}
    return frozenset(blocked.union(*(robot.obstacle for robot in report.robots)))


def pick_cells(task: Task, grid: Grid, blocked: frozenset[Cell]) -> tuple[Cell, ...]:
    """The cells from which a robot can pick the load of a task, the best first.

    A stranded load can be picked from beside it, too: it may stand on a robot that failed.
    """
    if not task.stranded:
        return () if task.pickup in blocked else (task.pickup,)
    cells = (task.pickup, *grid.neighbours(task.pickup))
    return tuple(cell for cell in cells if cell not in blocked)
