"""Brokers die, or are restarted."""

import time
from typing import Final

from benchmarks.faults import kafka
from benchmarks.faults.checker import Allowance
from benchmarks.faults.kinds.fault import BRIDGE_S, BROKER_S, REPEATS, Fault
from benchmarks.faults.streams import Stream
from benchmarks.faults.world import World


def brokers_die(_stream: Stream, _hold_s: float) -> Allowance:
    """A hand-over, or a producer that begins a new epoch, may repeat what is in flight.

    Brokers that come back one after the other refuse a batch (NOT_ENOUGH_REPLICAS) and look at
    the one behind it a moment later, which is out of order then: librdkafka begins a new epoch,
    and sends once more what the dead ones had written and not answered.
    """
    return REPEATS


def kill_brokers(world: World, _target: int) -> None:
    """Kill every broker that runs."""
    for node in world.cluster.running:
        world.cluster.kill(node)


def start_brokers(world: World, _target: int) -> int:
    """Start them all again; returns when they were back."""
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


FAULTS: Final = (
    Fault(
        'broker_kill',
        'every broker SIGKILLed, and started again',
        (1.0, 12.0),
        kill_brokers,
        start_brokers,
        brokers_die,
        required_s=BROKER_S,
        seconds=25.0,
    ),
    Fault(
        'leader_kill',
        "a topic's leader of three SIGKILLed, and started again",
        (5.0, 12.0),
        _kill_leader,
        _start_leader,
        brokers_die,
        by_another=True,
        required_s=BRIDGE_S,
        seconds=20.0,
        needs='cluster',
    ),
    Fault(
        'rolling_restart',
        'each broker of three stopped in order (SIGTERM), and started again',
        (0.0, 0.0),
        _restart_each,
        lambda *_: time.time_ns(),
        brokers_die,
        by_another=True,
        required_s=BRIDGE_S,
        seconds=40.0,
        needs='cluster',
    ),
)
