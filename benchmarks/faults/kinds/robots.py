"""ROS nodes die."""

from typing import Final

from benchmarks.faults.checker import Allowance
from benchmarks.faults.kinds.fault import LEASE_S, NOTHING, Fault, costs_nothing
from benchmarks.faults.streams import SUBSCRIBER_CACHE, WINDOW, Stream
from benchmarks.faults.world import World


def _subscriber_dies(stream: Stream, _hold_s: float) -> Allowance:
    """The next one sees what is new first, and then what was in flight to the dead one."""
    if not stream.is_from_kafka:
        return NOTHING
    cache = SUBSCRIBER_CACHE + 1
    return Allowance(
        duplicated=True,
        lost=cache,
        out_of_order=WINDOW + cache,
        why=f"{cache} in the dead subscriber's cache",
    )


def _from_kafka(world: World, _target: int) -> str:
    return next(stream.name for stream in world.setting.streams if stream.is_from_kafka)


def _publisher(world: World, target: int) -> str:
    names = sorted(world.publishers)
    return names[target % len(names)]


FAULTS: Final = (
    Fault(
        'subscriber_kill',
        'subscriber SIGKILLed, and a new one started',
        (0.0, 3.0),
        lambda world, _: world.subscriber.kill(),
        lambda world, _: world.subscriber.start(),
        _subscriber_dies,
        aims_at=_from_kafka,
        after_s=LEASE_S + 4.0,
        seconds=35.0,
        needs='to ROS',
    ),
    Fault(
        'publisher_kill',
        'publisher SIGKILLed, and started again',
        (0.0, 3.0),
        lambda world, target: world.publishers[_publisher(world, target)].kill(),
        lambda world, target: world.start_publisher(_publisher(world, target)),
        costs_nothing,
        aims_at=_publisher,
        seconds=10.0,
        needs='from ROS',
    ),
)
