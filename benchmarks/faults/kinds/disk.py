"""The disk is full while it is needed."""

import contextlib
from typing import Final

from benchmarks.faults.kinds.broker import brokers_die, kill_brokers, start_brokers
from benchmarks.faults.kinds.fault import BROKER_S, Fault
from benchmarks.faults.world import World

_BALLOON: Final = 'balloon'
_BALLOON_BYTES: Final = 64 * 1024


def _fill_disk(world: World, target: int) -> None:
    """Leave no room for a spool while it is needed: Kafka is away."""
    balloon = world.spools / _BALLOON
    with balloon.open('wb', buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(_BALLOON_BYTES))
    kill_brokers(world, target)


def _empty_disk(world: World, target: int) -> int:
    (world.spools / _BALLOON).unlink()
    return start_brokers(world, target)


FAULTS: Final = (
    Fault(
        'disk_full',
        'the disk of the spools full while every broker is SIGKILLed',
        (3.0, 12.0),
        _fill_disk,
        _empty_disk,
        brokers_die,
        required_s=BROKER_S,
        seconds=25.0,
        needs='disk',
    ),
)
