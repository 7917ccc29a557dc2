"""Records that nobody should write."""

from typing import Final

from benchmarks.faults.kinds.fault import Fault, costs_nothing
from benchmarks.faults.world import World

_HOSTILE_ORDERS: Final = 7
_YEAR_S: Final = 365 * 24 * 3600
_CLOCKS_S: Final = (-10 * _YEAR_S, 10 * _YEAR_S, -3600, 3600, -50 * _YEAR_S)
_CLOCK_STAY_S: Final = 1.0


def _send_hostile(world: World, _target: int) -> None:
    for stream in world.setting.streams:
        world.tell(stream.name, f'hostile {_HOSTILE_ORDERS}')


def _jump(world: World, target: int) -> None:
    for place in range(len(_CLOCKS_S)):
        clock_s = _CLOCKS_S[(target + place) % len(_CLOCKS_S)]
        for stream in world.setting.streams:
            if stream.is_from_kafka:
                world.tell(stream.name, f'clock {clock_s}')
        world.pause(_CLOCK_STAY_S)


def _jump_back(world: World, _target: int) -> None:
    for stream in world.setting.streams:
        if stream.is_from_kafka:
            world.tell(stream.name, 'clock 0')


FAULTS: Final = (
    Fault(
        'hostile',
        'poison, oversize and hostile records',
        (1.0, 2.0),
        _send_hostile,
        lambda *_: None,  # it mends itself
        costs_nothing,
        seconds=5.0,
    ),
    Fault(
        'clock',
        'record times that jump by an hour, 10 and 50 years',
        (0.0, 0.0),
        _jump,
        _jump_back,
        costs_nothing,
        seconds=10.0,
        needs='to ROS',
    ),
)
