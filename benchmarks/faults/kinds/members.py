"""More bridges come and go."""

from typing import Final

from benchmarks.faults.kinds.fault import Fault, repeats_from_kafka
from benchmarks.faults.parts import end
from benchmarks.faults.world import World

_BRIDGES: Final = 2
_STAY_S: Final = 4.0


def _join(world: World, target: int) -> None:
    routes = ','.join(s.name for s in world.setting.streams if s.is_from_kafka)
    for number in range(_BRIDGES):
        bridge = world.make_bridge(f'bridge-joining-{number}', '--routes', routes)
        world.extra.append(bridge)
        bridge.start()
        world.pause(_STAY_S)
    # One goes in order, the other one does not.
    order = [world.extra[target % _BRIDGES], world.extra[(target + 1) % _BRIDGES]]
    end(order[0], 30.0)
    world.pause(_STAY_S / 2)
    order[0].start()
    order[1].kill()


def _leave(world: World, _target: int) -> None:
    for bridge in world.extra:
        end(bridge, 30.0)
    world.extra.clear()


FAULTS: Final = (
    Fault(
        'rebalance_storm',
        'two more bridges that join, leave and die',
        (1.0, 5.0),
        _join,
        _leave,
        repeats_from_kafka,
        seconds=35.0,
        needs='to ROS',
    ),
)
