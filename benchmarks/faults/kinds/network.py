"""Cables are pulled, and packets are lost."""

from typing import Final

from benchmarks.faults.checker import Allowance
from benchmarks.faults.kinds.fault import (
    LEASE_S,
    NOTHING,
    Fault,
    back_as_it_begins,
    costs_nothing,
    repeats_from_kafka,
)
from benchmarks.faults.streams import READER_CACHE, WINDOW, Stream

_LOST_SHARES: Final = (0.02, 0.1, 0.2)


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


def _share(target: int) -> float:
    return _LOST_SHARES[target % len(_LOST_SHARES)]


FAULTS: Final = (
    Fault(
        'cut_kafka',
        'the cable to Kafka pulled',
        (3.0, 20.0),
        lambda world, _: world.hosts.site.unplug(),
        back_as_it_begins(lambda world, _: world.hosts.site.plug_in()),
        repeats_from_kafka,
        seconds=25.0,
        needs='hosts',
    ),
    Fault(
        'cut_robot',
        'the cable to the robot pulled for less than the lease',
        (3.0, 9.0),
        lambda world, _: world.hosts.robot.unplug(),
        back_as_it_begins(lambda world, _: world.hosts.robot.plug_in()),
        _robot_is_cut_off,
        needs='hosts',
    ),
    Fault(
        'cut_robot_long',
        'the cable to the robot pulled for 30 s, more than the lease',
        (30.0, 30.0),
        lambda world, _: world.hosts.robot.unplug(),
        back_as_it_begins(lambda world, _: world.hosts.robot.plug_in()),
        _robot_is_cut_off,
        seconds=45.0,
        needs='hosts',
    ),
    Fault(
        'loss_kafka',
        '2 to 20 % of the TCP packets to and from Kafka lost',
        (8.0, 15.0),
        lambda world, target: world.hosts.site.lose(_share(target), 'tcp'),
        back_as_it_begins(lambda world, _: world.hosts.site.lose(0)),
        repeats_from_kafka,
        seconds=20.0,
        needs='hosts',
    ),
    Fault(
        'loss_robot',
        '2 to 20 % of the UDP packets to and from the robot lost',
        (8.0, 15.0),
        lambda world, target: world.hosts.robot.lose(_share(target), 'udp'),
        back_as_it_begins(lambda world, _: world.hosts.robot.lose(0)),
        costs_nothing,
        seconds=20.0,
        needs='hosts',
    ),
)
