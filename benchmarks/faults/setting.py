"""What a run is made with."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.faults.memberships import MEMBERSHIPS, Membership
from benchmarks.faults.streams import Stream
from rig.hosts import Hosts


class Setting(NamedTuple):
    """What a run is made with.

    Args:
        place: Directory for its files.
        rate: Orders per second, of each stream.
        domain: Its ROS domain.
        brokers: How many of Kafka's.
        hosts: Where what runs; None runs all here.
        bridges: How many run the same file; with two, one stands by.
        has_own_disk: Whether the spools are on a disk of their own, which can be filled.
        membership: How the bridges are members of Kafka's groups.
    """

    place: Path
    streams: Sequence[Stream]
    rate: float
    seed: int
    domain: int
    brokers: int
    hosts: Hosts | None = None
    bridges: int = 1
    has_own_disk: bool = False
    membership: Membership = MEMBERSHIPS['static']
