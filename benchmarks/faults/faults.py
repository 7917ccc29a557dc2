"""The faults: how each is done, how it is undone, and what the guarantees let it cost.

`inject` breaks something, `recover` mends it and tells when the broken thing was back. What is
aimed at one of several is chosen by a number of the plan, so that a seed repeats it.
"""

import contextlib
import signal
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from benchmarks.faults import kafka
from benchmarks.faults.checker import Allowance
from benchmarks.faults.parts import Part
from benchmarks.faults.streams import READER_CACHE, SUBSCRIBER_CACHE, WINDOW, Stream
from benchmarks.faults.world import World

LEASE_S: Final = 20.0
"""How long DDS waits for a silent participant before it is gone, by default."""

_BROKER_S: Final = 5.0
_BRIDGE_S: Final = 10.0
_STORM_BRIDGES: Final = 2
_STORM_STAY_S: Final = 4.0
_HOSTILE_ORDERS: Final = 7
_YEAR_S: Final = 365 * 24 * 3600
_CLOCKS_S: Final = (-10 * _YEAR_S, 10 * _YEAR_S, -3600, 3600, -50 * _YEAR_S)
_WAITING_S: Final = 5.0
_MATCH_S: Final = 3.0
_LOST_SHARES: Final = (0.02, 0.1, 0.2)
_BALLOON: Final = 'balloon'
_BALLOON_BYTES: Final = 64 * 1024
_CLOCK_STAY_S: Final = 1.0

NOTHING: Final = Allowance()
REPEATS: Final = Allowance(duplicated=True)


class Fault(NamedTuple):
    """A kind of fault.

    Args:
        name: For the command line.
        words: For the table.
        hold_s: Between breaking and mending, shortest and longest.
        inject: Breaks it; the number chooses among several.
        recover: Mends it; returns when it was back, in nanoseconds since 1970, None where
            nothing was gone.
        allows: What it may cost a stream.
        aims_at: The one stream that it is aimed at; None where it concerns all.
        after_s: How long it goes on having effects.
        by_another: Whether another takes over, so that the time to recover counts from the
            breaking.
        required_s: Longest time to recover; None where nothing is required.
        seconds: How long all of it takes, roughly, for the plan.
        needs: What of a run it needs: `cluster`, `hosts`, `disk`, `one bridge`, `two bridges`.
    """

    name: str
    words: str
    hold_s: tuple[float, float]
    inject: Callable[[World, int], None]
    recover: Callable[[World, int], int | None]
    allows: Callable[[Stream, float], Allowance]
    aims_at: Callable[[World, int], str] | None = None
    after_s: float = 0.0
    by_another: bool = False
    required_s: float | None = None
    seconds: float = 15.0
    needs: str = ''


def _costs_nothing(_stream: Stream, _hold_s: float) -> Allowance:
    return NOTHING


def _repeats_from_kafka(stream: Stream, _hold_s: float) -> Allowance:
    """A hand-over of partitions may repeat what is in flight."""
    return REPEATS if stream.is_from_kafka else NOTHING


def _brokers_die(_stream: Stream, _hold_s: float) -> Allowance:
    """A hand-over, or a producer that begins a new epoch, may repeat what is in flight.

    Brokers that come back one after the other refuse a batch (NOT_ENOUGH_REPLICAS) and look at
    the one behind it a moment later, which is out of order then: librdkafka begins a new epoch,
    and sends once more what the dead ones had written and not answered.
    """
    return REPEATS


# Kafka


def _kill_brokers(world: World, _target: int) -> None:
    for node in world.cluster.running:
        world.cluster.kill(node)


def _start_brokers(world: World, _target: int) -> int:
    return kafka.start_again(world.cluster, range(world.setting.brokers))


def _kill_leader(world: World, target: int) -> None:
    streams = world.setting.streams
    stream = streams[target % len(streams)]
    node = world.cluster.leader(stream.kafka_topic, target % stream.lines)
    world.cluster.kill(node)


def _start_leader(world: World, _target: int) -> int:
    gone = set(range(world.setting.brokers)) - set(world.cluster.running)
    return kafka.start_again(world.cluster, sorted(gone))


def _restart_each(world: World, _target: int) -> None:
    """One broker after the other, as an upgrade does it."""
    for node in range(world.setting.brokers):
        world.cluster.stop(node)
        kafka.start_again(world.cluster, [node])
        world.check()


def _all_restarted(_world: World, _target: int) -> int:
    return time.time_ns()


# The bridge


def _bridge(world: World, target: int) -> Part:
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


def _end_bridge(world: World, target: int) -> None:
    _bridge(world, target).end(30.0)


def _bridge_restarts(stream: Stream, _hold_s: float) -> Allowance:
    """Stopped in order, it loses what is published while there is none."""
    if stream.durability == 'volatile':
        return Allowance(lost_while_away=True, why='sent until it is back')
    return NOTHING


def _stop_bridge(world: World, target: int) -> None:
    _bridge(world, target).send(signal.SIGSTOP)


def _continue_bridge(world: World, target: int) -> int:
    back_ns = time.time_ns()
    _bridge(world, target).send(signal.SIGCONT)
    return back_ns


def _bridge_stops(stream: Stream, hold_s: float) -> Allowance:
    if stream.is_from_kafka:
        return REPEATS
    if stream.durability == 'transient_local' or hold_s < LEASE_S / 2:
        return NOTHING
    why = f'beyond the lease: {stream.in_bridge} in its memory, and what is sent meanwhile'
    return Allowance(lost=stream.in_bridge, lost_while_away=True, why=why)


def _black_out(world: World, target: int) -> None:
    """Kafka goes first, so that something waits for it; then the bridge, which starts again."""
    _kill_brokers(world, target)
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


# The network


def _cut_kafka(world: World, _target: int) -> None:
    world.hosts.site.unplug()


def _join_kafka(world: World, _target: int) -> int:
    back_ns = time.time_ns()
    world.hosts.site.plug_in()
    return back_ns


def _cut_robot(world: World, _target: int) -> None:
    world.hosts.robot.unplug()


def _join_robot(world: World, _target: int) -> int:
    back_ns = time.time_ns()
    world.hosts.robot.plug_in()
    return back_ns


def _robot_is_cut_off(stream: Stream, hold_s: float) -> Allowance:
    """Beyond the lease both ends take each other for gone."""
    if hold_s < LEASE_S / 2:
        return NOTHING
    if stream.is_from_kafka:
        # The readers's end may have gone on with what the other end takes for lost.
        return Allowance(duplicated=True, out_of_order=WINDOW, why='the window comes again')
    if stream.durability == 'transient_local':
        return NOTHING
    why = f'beyond the lease: {READER_CACHE} in the cache, and what is sent meanwhile'
    return Allowance(lost=READER_CACHE, lost_while_away=True, why=why)


def _lose_to_kafka(world: World, target: int) -> None:
    world.hosts.site.lose(_LOST_SHARES[target % len(_LOST_SHARES)], 'tcp')


def _lose_to_robot(world: World, target: int) -> None:
    world.hosts.robot.lose(_LOST_SHARES[target % len(_LOST_SHARES)], 'udp')


def _lose_no_more(world: World, _target: int) -> int:
    back_ns = time.time_ns()
    world.hosts.site.lose(0)
    world.hosts.robot.lose(0)
    return back_ns


# The disk


def _fill_disk(world: World, target: int) -> None:
    """Leave no room for a spool while it is needed: Kafka is away."""
    balloon = world.spools / _BALLOON
    with balloon.open('wb', buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(_BALLOON_BYTES))
    _kill_brokers(world, target)


def _empty_disk(world: World, target: int) -> int:
    (world.spools / _BALLOON).unlink()
    return _start_brokers(world, target)


# ROS nodes


def _kill_subscriber(world: World, _target: int) -> None:
    world.subscriber.kill()


def _start_subscriber(world: World, _target: int) -> int:
    return world.subscriber.start()


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


def _kill_publisher(world: World, target: int) -> None:
    world.publishers[_publisher(world, target)].kill()


def _start_publisher(world: World, target: int) -> int:
    return world.start_publisher(_publisher(world, target))


# Bridges that come and go


def _join(world: World, target: int) -> None:
    routes = ','.join(s.name for s in world.setting.streams if s.is_from_kafka)
    for number in range(_STORM_BRIDGES):
        bridge = world.make_bridge(f'bridge-joining-{number}', '--routes', routes)
        world.extra.append(bridge)
        bridge.start()
        world.pause(_STORM_STAY_S)
    # One goes in order, the other one does not.
    order = [world.extra[target % _STORM_BRIDGES], world.extra[(target + 1) % _STORM_BRIDGES]]
    order[0].end(30.0)
    world.pause(_STORM_STAY_S / 2)
    order[0].start()
    order[1].kill()


def _leave(world: World, _target: int) -> None:
    for bridge in world.extra:
        bridge.end(30.0)
    world.extra.clear()


# Records


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


def _nothing(_world: World, _target: int) -> None:
    """It mends itself."""


FAULTS: Final[Mapping[str, Fault]] = MappingProxyType(
    {
        fault.name: fault
        for fault in (
            Fault(
                'broker_kill',
                'every broker SIGKILLed, and started again',
                (1.0, 12.0),
                _kill_brokers,
                _start_brokers,
                _brokers_die,
                required_s=_BROKER_S,
                seconds=25.0,
            ),
            Fault(
                'leader_kill',
                "a topic's leader of three SIGKILLed, and started again",
                (5.0, 12.0),
                _kill_leader,
                _start_leader,
                _brokers_die,
                by_another=True,
                required_s=_BRIDGE_S,
                seconds=20.0,
                needs='cluster',
            ),
            Fault(
                'rolling_restart',
                'each broker of three stopped in order (SIGTERM), and started again',
                (0.0, 0.0),
                _restart_each,
                _all_restarted,
                _brokers_die,
                by_another=True,
                required_s=_BRIDGE_S,
                seconds=40.0,
                needs='cluster',
            ),
            Fault(
                'bridge_kill',
                'bridge SIGKILLed, and started again',
                (0.0, 0.0),
                _kill_bridge,
                _start_bridge,
                _bridge_dies,
                required_s=_BRIDGE_S,
                needs='one bridge',
            ),
            Fault(
                'blackout',
                'every broker SIGKILLed, then the bridge, which starts before they do',
                (1.0, 6.0),
                _black_out,
                _start_brokers,
                _all_goes_dark,
                required_s=_BRIDGE_S,
                seconds=40.0,
                needs='one bridge',
            ),
            Fault(
                'bridge_restart',
                'bridge stopped in order (SIGTERM), and started again',
                (0.0, 2.0),
                _end_bridge,
                _start_bridge,
                _bridge_restarts,
                required_s=_BRIDGE_S,
                needs='one bridge',
            ),
            Fault(
                'bridge_stop',
                'bridge stopped for 30 s (SIGSTOP)',
                (30.0, 30.0),
                _stop_bridge,
                _continue_bridge,
                _bridge_stops,
                seconds=45.0,
                needs='one bridge',
            ),
            Fault(
                'bridge_pause',
                'bridge stopped for 8 s (SIGSTOP)',
                (8.0, 8.0),
                _stop_bridge,
                _continue_bridge,
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
                required_s=_BRIDGE_S,
                by_another=True,
                seconds=25.0,
                needs='two bridges',
            ),
            Fault(
                'take_over_stop',
                'one bridge of two stopped for 30 s (SIGSTOP), the other one takes over',
                (30.0, 30.0),
                _stop_bridge,
                _continue_bridge,
                _bridge_is_replaced,
                required_s=_BRIDGE_S,
                by_another=True,
                seconds=45.0,
                needs='two bridges',
            ),
            Fault(
                'cut_kafka',
                'the cable to Kafka pulled',
                (3.0, 20.0),
                _cut_kafka,
                _join_kafka,
                _repeats_from_kafka,
                seconds=25.0,
                needs='hosts',
            ),
            Fault(
                'cut_robot',
                'the cable to the robot pulled for less than the lease',
                (3.0, 9.0),
                _cut_robot,
                _join_robot,
                _robot_is_cut_off,
                needs='hosts',
            ),
            Fault(
                'cut_robot_long',
                'the cable to the robot pulled for 30 s, more than the lease',
                (30.0, 30.0),
                _cut_robot,
                _join_robot,
                _robot_is_cut_off,
                seconds=45.0,
                needs='hosts',
            ),
            Fault(
                'loss_kafka',
                '2 to 20 % of the TCP packets to and from Kafka lost',
                (8.0, 15.0),
                _lose_to_kafka,
                _lose_no_more,
                _repeats_from_kafka,
                seconds=20.0,
                needs='hosts',
            ),
            Fault(
                'loss_robot',
                '2 to 20 % of the UDP packets to and from the robot lost',
                (8.0, 15.0),
                _lose_to_robot,
                _lose_no_more,
                _costs_nothing,
                seconds=20.0,
                needs='hosts',
            ),
            Fault(
                'disk_full',
                'the disk of the spools full while every broker is SIGKILLed',
                (3.0, 12.0),
                _fill_disk,
                _empty_disk,
                _brokers_die,
                required_s=_BROKER_S,
                seconds=25.0,
                needs='disk',
            ),
            Fault(
                'subscriber_kill',
                'subscriber SIGKILLed, and a new one started',
                (0.0, 3.0),
                _kill_subscriber,
                _start_subscriber,
                _subscriber_dies,
                aims_at=_from_kafka,
                after_s=LEASE_S + 4.0,
                seconds=35.0,
            ),
            Fault(
                'publisher_kill',
                'publisher SIGKILLed, and started again',
                (0.0, 3.0),
                _kill_publisher,
                _start_publisher,
                _costs_nothing,
                aims_at=_publisher,
                seconds=10.0,
            ),
            Fault(
                'rebalance_storm',
                'two more bridges that join, leave and die',
                (1.0, 5.0),
                _join,
                _leave,
                _repeats_from_kafka,
                seconds=35.0,
            ),
            Fault(
                'hostile',
                'poison, oversize and hostile records',
                (1.0, 2.0),
                _send_hostile,
                _nothing,
                _costs_nothing,
                seconds=5.0,
            ),
            Fault(
                'clock',
                'record times that jump by an hour, 10 and 50 years',
                (0.0, 0.0),
                _jump,
                _jump_back,
                _costs_nothing,
                seconds=10.0,
            ),
        )
    }
)
