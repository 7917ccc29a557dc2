"""The bridge dies or stands still, alone or as one of two."""

import signal
import time
from typing import Final

from benchmarks.faults.checker import Allowance
from benchmarks.faults.kinds.broker import kill_brokers, start_brokers
from benchmarks.faults.kinds.fault import (
    BRIDGE_S,
    LEASE_S,
    NOTHING,
    REPEATS,
    Fault,
    back_as_it_begins,
)
from benchmarks.faults.parts import end
from benchmarks.faults.streams import READER_CACHE, Stream
from benchmarks.faults.world import World
from rig.processes import Process

_WAITING_S: Final = 5.0
_MATCH_S: Final = 3.0
_HANDS_OVER_S: Final = 12.0
"""How long one that goes on may send what it holds, though another runs its routes."""


def _bridge(world: World, target: int) -> Process:
    return world.bridges[target % len(world.bridges)]


def _kill_bridge(world: World, target: int) -> None:
    _bridge(world, target).kill()


def _start_bridge(world: World, target: int) -> int:
    return _bridge(world, target).start()


def _bridge_dies(stream: Stream, _hold_s: float) -> Allowance:
    if stream.is_from_kafka:
        return REPEATS
    if stream.durability == 'transient_local':
        return NOTHING
    why = f'{stream.in_bridge} in its memory, and what is sent until it is back'
    again = stream.spool is not None  # what was on disk and on its way may have been taken
    return Allowance(again, stream.in_bridge, lost_while_away=True, why=why)


def _bridge_is_replaced(stream: Stream, _hold_s: float) -> Allowance:
    """What the dead one had on its way may come after all, and once more from the other."""
    return _bridge_dies(stream, _hold_s)._replace(duplicated=True)


def _bridge_restarts(stream: Stream, _hold_s: float) -> Allowance:
    """Stopped in order, it loses what is published while there is none."""
    if stream.durability == 'volatile':
        return Allowance(lost_while_away=True, why='sent until it is back')
    return NOTHING


def _bridge_stops(stream: Stream, hold_s: float) -> Allowance:
    if stream.is_from_kafka:
        return REPEATS
    if stream.durability == 'transient_local' or hold_s < LEASE_S / 2:
        return NOTHING
    why = f'beyond the lease: {stream.in_bridge} in its memory, and what is sent meanwhile'
    return Allowance(lost=stream.in_bridge, lost_while_away=True, why=why)


def _black_out(world: World, target: int) -> None:
    """Kafka goes first, so that something waits for it; then the bridge, which starts again."""
    kill_brokers(world, target)
    world.pause(_WAITING_S)
    gone_ns = time.time_ns()
    bridge = _bridge(world, target)
    bridge.kill()
    said = bridge.log.stat().st_size
    bridge.start()
    world.wait_until_subscribed(bridge, said)
    world.pause(_MATCH_S)
    world.away_ns = gone_ns, time.time_ns()


def _all_goes_dark(stream: Stream, hold_s: float) -> Allowance:
    found = _bridge_dies(stream, hold_s)._replace(duplicated=True)
    if stream.durability != 'volatile':
        return found
    if stream.spool is None:
        why = f'{stream.in_bridge} in its memory, and what is sent until it is back'
        return found._replace(is_held_back=True, why=why)
    why = f'{READER_CACHE} in the cache of its reader, and what is sent until it takes again'
    return found._replace(lost=READER_CACHE, why=why)


def _stop(world: World, target: int) -> None:
    _bridge(world, target).send(signal.SIGSTOP)


@back_as_it_begins
def _go_on(world: World, target: int) -> None:
    _bridge(world, target).send(signal.SIGCONT)


FAULTS: Final = (
    Fault(
        'bridge_kill',
        'bridge SIGKILLed, and started again',
        (0.0, 0.0),
        _kill_bridge,
        _start_bridge,
        _bridge_dies,
        required_s=BRIDGE_S,
        needs='one bridge',
    ),
    Fault(
        'blackout',
        'every broker SIGKILLed, then the bridge, which starts before they do',
        (1.0, 6.0),
        _black_out,
        start_brokers,
        _all_goes_dark,
        required_s=BRIDGE_S,
        seconds=40.0,
        needs='one bridge',
    ),
    Fault(
        'bridge_restart',
        'bridge stopped in order (SIGTERM), and started again',
        (0.0, 2.0),
        lambda world, target: end(_bridge(world, target), 30.0),
        _start_bridge,
        _bridge_restarts,
        required_s=BRIDGE_S,
        needs='one bridge',
    ),
    Fault(
        'bridge_stop',
        'bridge stopped for 30 s (SIGSTOP)',
        (30.0, 30.0),
        _stop,
        _go_on,
        _bridge_stops,
        seconds=45.0,
        needs='one bridge',
    ),
    Fault(
        'bridge_pause',
        'bridge stopped for 8 s (SIGSTOP)',
        (8.0, 8.0),
        _stop,
        _go_on,
        _bridge_stops,
        seconds=20.0,
        needs='one bridge',
    ),
    Fault(
        'take_over',
        'one bridge of two SIGKILLed, the other one takes over',
        (12.0, 15.0),
        _kill_bridge,
        _start_bridge,
        _bridge_is_replaced,
        required_s=BRIDGE_S,
        by_another=True,
        seconds=25.0,
        needs='two bridges',
    ),
    Fault(
        'take_over_stop',
        'one bridge of two stopped for 30 s (SIGSTOP), the other one takes over',
        (30.0, 30.0),
        _stop,
        _go_on,
        _bridge_is_replaced,
        after_s=_HANDS_OVER_S,
        required_s=BRIDGE_S,
        keeps_spool=True,
        by_another=True,
        seconds=45.0,
        needs='two bridges',
    ),
)
