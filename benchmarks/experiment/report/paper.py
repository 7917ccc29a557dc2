"""What the paper published: section VII, Tables I to III and the prose beside them.

The paper names no rates. They follow from its counts in ten minutes: 5,787 orders are 9.6 a
second, 50,152 and 51,683 about 86, 95,664 to 98,733 about 160.
"""

from typing import Final, NamedTuple

SECONDS: Final = 600.0
"""How long each of its experiments ran."""


class Memory(NamedTuple):
    """Of one bridge's container, in MiB."""

    before_mib: float
    peak_mib: float


class Published(NamedTuple):
    """One of its experiments.

    Args:
        table: Where its counts stand; the other figures stand in the prose on this table.
        load: Named as ours.
        depth: Of KEEP_LAST at both ends.
        fastest_s: Latency in seconds of the fastest order; no median is published.
    """

    table: str
    load: str
    depth: int
    producer: int
    kafka_ros: int
    ros_kafka: int
    consumer: int
    fastest_s: float
    slowest_s: float
    kafka_ros_memory: Memory
    ros_kafka_memory: Memory

    @property
    def lost(self) -> int:
        """Orders that never came."""
        return self.producer - self.consumer

    @property
    def loss(self) -> float:
        """Share of the orders that never came, 0 to 1."""
        return self.lost / self.producer


PUBLISHED: Final = (
    Published(
        'I', '9.6', 10, 5787, 5787, 5787, 5787, 0.006791, 0.282652,
        Memory(24.43, 25.17), Memory(24.20, 25.2),
    ),
    Published(
        'I', '86', 10, 51683, 51683, 51593, 51593, 0.006467, 0.851981,
        Memory(24.45, 26.2), Memory(24.32, 25.8),
    ),
    Published(
        'I', '160', 10, 95664, 95664, 92195, 92195, 0.006247, 1.107546,
        Memory(24.43, 26.54), Memory(24.18, 26.54),
    ),
    Published(
        'II', '86', 100, 50152, 50152, 50152, 50152, 0.006465, 1.023807,
        Memory(24.46, 26.36), Memory(24.21, 26.43),
    ),
    Published(
        'II', '160', 100, 98733, 98733, 98503, 98503, 0.006582, 0.746120,
        Memory(24.82, 26.60), Memory(24.26, 26.74),
    ),
    Published(
        'III', '160', 200, 97995, 97995, 97995, 97995, 0.006730, 1.029223,
        Memory(24.64, 28.44), Memory(24.40, 28.35),
    ),
)  # fmt: skip

TABLES: Final = {'I': 10, 'II': 100, 'III': 200}
"""The depth that each table is about."""

RATES: Final = {'9.6': 9.6, '86': 86.0, '160': 160.0}
"""Orders per second of its loads."""

MACHINE: Final = '2.60 GHz 6-core Intel Core i7, 16 GB DDR4 at 2400 MHz, macOS Big Sur 11.5'
PLACES: Final = 'every part in a container of its own, with 1.941 GiB each'


def published(load: str, depth: int) -> Published | None:
    """Find what the paper published of a load at a depth; None where it did not run it."""
    return next((one for one in PUBLISHED if (one.load, one.depth) == (load, depth)), None)
