"""Two bridges with workers that take turns at a route: a worker is killed, then a whole bridge.

The guarantees are those of docs: 8 what SIGKILL can cost. Bridges of one process:
tests/faults/test_take_over.py.
"""

import os
import signal
from contextlib import ExitStack

from support.bridges.numbers_to_kafka import LATCHED, published
from support.bridges.routes import to_kafka, to_ros
from support.bridges.taking_turns import (
    STANDS_BY,
    TAKES,
    assert_each_once_in_order,
    wait_for_all,
    wait_for_order,
)
from support.bridges.workers import kill, pids, wait_until_gone
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave

ITS = 2  # the worker of the route; the first one has those to ROS


def turns(*bridges: Process) -> int:
    """How often workers have taken their turn."""
    return sum(bridge.output().count(TAKES) for bridge in bridges)


def kill_all(bridge: Process) -> None:
    """SIGKILL a whole bridge, as the end of its machine does: nobody is left to drain."""
    workers = [pids(bridge, worker)[-1] for worker in (1, 2)]
    bridge.send(signal.SIGSTOP)  # else it may start another worker, or they may drain
    for pid in workers:
        os.kill(pid, signal.SIGKILL)
    bridge.kill()
    wait_until_gone(*workers)


def test_guarantee_8_a_killed_worker_and_a_killed_bridge_are_taken_over_from_and_nothing_is_lost(
    bench: Bench, topic: str, leave: Leave
) -> None:
    """From the worker by the other bridge, or by the worker in its place: Kafka chooses."""
    count = 3000
    there = f'{topic}.there'
    bench.create_topic(there)
    routes = [to_kafka('/orders', topic, exclusive=True), to_ros(there, '/there')]
    config = bench.config(routes, workers=2, ros={'lease_s': 3})
    options = (*LATCHED, *leave.options, '--count', str(count))
    with ExitStack() as stack:
        first = stack.enter_context(bench.bridge(config))
        first.wait_for(TAKES)
        second = stack.enter_context(bench.bridge(config))
        second.wait_for(STANDS_BY)
        publisher = stack.enter_context(bench.publisher('/orders', *options))
        leave.up_to(1000)
        wait_for_order(bench, topic, 300, first)
        kill(first, ITS)
        eventually(lambda: turns(first, second) == 2, 60, first.output)
        dying, other = (second, first) if turns(second) else (first, second)
        other.wait_for(STANDS_BY)
        assert not published(publisher)

        leave.up_to(2000)
        wait_for_order(bench, topic, 1300, first, second)
        kill_all(dying)
        eventually(lambda: turns(first, second) == 3, 60, other.output)
        assert not published(publisher)

        leave.up_to(count)
        records = wait_for_all(bench, topic, count, other)
        assert other.end() == 0, other.output()
    assert turns(first, second) == 3, 'one at a time'
    assert_each_once_in_order(records, count)
