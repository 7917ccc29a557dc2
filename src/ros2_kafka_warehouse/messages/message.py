"""What all messages are, and how they name a cell."""

from functools import lru_cache

import msgspec

Cell = tuple[int, int]


class Message(msgspec.Struct, frozen=True, rename='camel', omit_defaults=True):
    """A value that goes over a topic; JSON by `ros2_kafka_warehouse.codec`."""


def node_id(cell: Cell) -> str:
    """The name of a cell as a node of VDA 5050, for example `3,14`."""
    return f'{cell[0]},{cell[1]}'


@lru_cache(maxsize=65_536)  # asked for each robot in each step
def node_cell(node: str) -> Cell:
    """The cell that a node names.

    Raises:
        ValueError: It names none.
    """
    column, row = node.split(',')
    return int(column), int(row)
