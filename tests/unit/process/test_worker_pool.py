"""What the workers of a bridge come to where the system has no room for them."""

import errno
import selectors
from typing import NoReturn

import pytest

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.process.draining import drain
from ros2_kafka_bridge.process.plan import Plan, RoutePlan
from ros2_kafka_bridge.process.worker_pool import WorkerPool
from ros2_kafka_bridge.threads.stop import Stop


def test_a_worker_that_could_not_even_be_given_its_plan_makes_the_end_a_failure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_room(*_: object) -> NoReturn:
        raise OSError(errno.EMFILE, 'Too many open files')

    monkeypatch.setattr('os.memfd_create', no_room)
    one = Plan('x', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=5.0),))
    with selectors.DefaultSelector() as selector:
        pool = WorkerPool(one, [], selector, Stop())
        pool.fill()
        pool.tick()
        (worker,) = pool.workers
        assert worker.problem == 'could not be started (Too many open files)'
        assert list(drain(pool, lambda: False)) == []
        assert pool.status == 1
        pool.close()
