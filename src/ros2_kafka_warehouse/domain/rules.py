"""The rules of the floor, and the words in which they are judged (by `referee`).

A frame is what the floor looked like at the end of a
step; what lies between two frames is judged by these rules:

- A robot is on free cells of the map, goes to one of the four neighbours, and takes at least the
  steps that its type needs for a cell. While it is between two cells it holds both.
- A cell is held by one robot. Two robots do not change places. A robot follows into the cell of
  another only if both make the whole way in the same step.
- A pallet is not driven through, nor the place of a robot that is not heard of.
- A robot with an empty battery does not drive.
- A robot carries one load, within the weight and the sizes of its type. A load comes from stock
  once, not before its release, by a robot that stands where it is; one that was given up with a
  robot is taken from where that stands, or from next to it. It ends at its delivery, once. In
  between it neither vanishes nor appears.

A robot that is missing in a frame is silent: it is somewhere near, and still holds its load.
"""

from collections.abc import Iterable, Mapping
from math import inf
from typing import NamedTuple

from ros2_kafka_warehouse.messages.message import Cell


class Limits(NamedTuple):
    """What a type of robot can do.

    Attributes:
        sizes: Of the loads that it can carry; None: any.
        acts_at_once: It picks or drops without standing still for it, and may have left the cell
            at the end of the step.
    """

    steps_per_cell: int = 1
    max_load_kg: float = inf
    sizes: frozenset[str] | None = None
    acts_at_once: bool = False


class Rules(NamedTuple):
    """What does not change: the map, the types of robots, where each robot is put on the floor."""

    rows: tuple[str, ...]
    types: Mapping[str, Limits] = {}
    homes: Mapping[str, Cell] = {}
    walls: str = '@'


class Job(NamedTuple):
    """What is to become of a load.

    Attributes:
        sources: Cells from which it comes out of stock.
        stranded: It was given up by the robot that had it, and may be taken from there.
    """

    task_id: str
    sources: frozenset[Cell]
    delivery: Cell
    released_s: float = -inf
    weight_kg: float = 0.0
    size: str = ''
    stranded: bool = False


class Seen(NamedTuple):
    """One robot in a frame.

    Attributes:
        cells: The one that it stands on, or the two that it is between: from, to.
        faulty: It reports an error, with which a load may have fallen.
        dropped: Tasks whose loads it says to have dropped of late.
    """

    robot: str
    cells: tuple[Cell, ...]
    loads: tuple[str, ...] = ()
    type: str = ''
    charge: float = 100.0
    faulty: bool = False
    dropped: frozenset[str] = frozenset()


class Frame(NamedTuple):
    """The floor at the end of a step.

    Attributes:
        removed: Robots that were carried off the floor.
        pallets: Cells on which something stands.
    """

    step: int
    time_s: float
    robots: tuple[Seen, ...]
    removed: frozenset[str] = frozenset()
    pallets: frozenset[Cell] = frozenset()


def distance(one: Cell, other: Cell) -> int:
    """Steps from a cell to another, if nothing is in the way."""
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def is_near(cells: Iterable[Cell], others: Iterable[Cell], most: int) -> bool:
    """Whether two of these cells are so many steps apart, at most."""
    others = tuple(others)
    return any(distance(one, other) <= most for one in cells for other in others)
