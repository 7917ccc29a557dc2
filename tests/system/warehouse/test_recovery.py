"""A warehouse whose parts are killed while it works."""

import pytest
from support.processes.harness import Bench
from support.warehouse.warehouses import Warehouse

from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_warehouse.messages.orders import OrderStatus
from ros2_kafka_warehouse.nodes import MODULES

WITHOUT_MEMORY = (
    'execution_profiles',
    'robot_failure_profile',
    'cost_estimator',
    'task_allocator',
    'path_planner',
)

WITH_MEMORY = tuple(name for name in MODULES if name not in WITHOUT_MEMORY)


@pytest.mark.kills_kafka
def test_every_part_may_be_killed_and_nothing_is_lost_or_carried_twice(
    own_bench: Bench, own_kafka: LocalKafka
) -> None:
    with Warehouse(own_bench, robots=6) as warehouse:
        warehouse.wait_until_up()
        requests = warehouse.requests(4 * (len(WITH_MEMORY) + 3))
        waiting = [requests[start : start + 4] for start in range(0, len(requests), 4)]
        warehouse.send(waiting.pop())
        warehouse.kill(*WITHOUT_MEMORY)
        for name in WITH_MEMORY:
            warehouse.send(waiting.pop())
            warehouse.kill(name)
        warehouse.send(waiting.pop())
        warehouse.kill('bridge')
        own_kafka.kill()
        own_kafka.start()
        warehouse.send(waiting.pop())
        warehouse.wait_for_ends(requests)
        warehouse.assert_each_line_was_delivered_once(requests)
        assert set(warehouse.ends().values()) == {OrderStatus.DELIVERED}
