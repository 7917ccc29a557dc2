"""A route with a spool in one of two workers, which is killed while Kafka is away.

The guarantees are those of docs: 2 at least once, 3 order, 7 stop is a drain, 8 what SIGKILL
costs. Without workers: tests/faults/test_spool_kills.py.
"""

import contextlib
import itertools
import os
import signal
from pathlib import Path

import pytest
from support.bridges.routes import to_ros
from support.bridges.spooled import WINDOW, arrived, file, numbers, on_disk, route
from support.bridges.workers import kill, pids, wait_until_gone
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import Leave
from support.spools.files import newest_on_disk

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

ITS = 2  # the worker of the route; the first one has those to ROS


def has_open(spool: Path) -> set[int]:
    """The processes that have a spool open, but for this one, as the kernel knows them."""
    found = set()
    for process in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):  # it has gone meanwhile
            if any(link.readlink() == spool for link in process.joinpath('fd').iterdir()):
                found.add(int(process.name))
    return found - {os.getpid()}


@pytest.mark.kills_kafka
def test_kills_of_worker_and_supervisor_cost_nothing_on_a_disk_that_one_has_guarantees_2_3_8(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str, leave: Leave
) -> None:
    """The next bridge begins while the worker that was left alone still has the spool."""
    bench, spool, held, count = own_bench, file(own_bench), 2000, 3000
    routes = [route(bench, own_topic), to_ros(f'{own_topic}.there', '/there')]
    config = bench.config(routes, workers=2, ros={'lease_s': 3})
    bench.create_topic(f'{own_topic}.there')
    options = (*leave.options, '--count', str(count))
    with bench.publisher('/orders', *options) as publisher, bench.bridge(config) as bridge:
        leave.up_to(1000)
        eventually(lambda: arrived(bench, own_topic) >= 500, 60, bridge.output)
        bench.close()
        own_kafka.kill()
        leave.up_to(held)
        eventually(lambda: newest_on_disk(spool) == held, 60, bridge.output)
        assert has_open(spool) == {pids(bridge, ITS)[-1]}

        kill(bridge, ITS)
        bridge.wait_for('the spool holds')
        assert has_open(spool) == {pids(bridge, ITS)[-1]}
        sent = itertools.count(held + 1)

        def matched() -> bool:
            leave.up_to(next(sent))  # one more for each look: who is matched gets it
            return newest_on_disk(spool) > held

        eventually(matched, 60, bridge.output)
        matched_at = next(sent)
        leave.up_to(count)
        publisher.wait_for('published')
        eventually(lambda: newest_on_disk(spool) == count, 60, bridge.output)

        alone = pids(bridge, ITS)[-1]
        os.kill(alone, signal.SIGSTOP)  # or it has put the spool away before the next one begins
        bridge.kill()
        with bench.drained(config) as again:
            again.wait_for(f'another process uses this spool (pid {alone})')
            assert has_open(spool) == {alone}
            os.kill(alone, signal.SIGCONT)
            again.wait_for('the spool holds')
            assert has_open(spool) == {pids(again, ITS)[-1]}
            wait_until_gone(*pids(bridge, 1), *pids(bridge, ITS))
            own_kafka.start()
            again.wait_for('the spool is empty again')
            eventually(lambda: on_disk(bench) == 0, 60, again.output)
    assert bridge.output().count('the supervisor has gone: draining') == 2
    found = numbers(bench, own_topic)
    once = list(dict.fromkeys(found))
    assert once == sorted(once)
    lost = set(range(count)).difference(once)
    assert lost <= set(range(held, matched_at - 1)), 'what was published while no worker was there'
    assert len(found) - len(once) <= WINDOW + 2, 'in flight when Kafka died, and the first on disk'
