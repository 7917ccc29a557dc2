"""Task Allocator: says which robot does which tasks, and in which order."""

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.task_allocator import TaskAllocator
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.tasks import Costs, Tasks
from ros2_kafka_warehouse.nodes.node import Module


def start(module: Module) -> None:
    """Allocate when there are new costs."""
    allocator = TaskAllocator(module.site)
    tasks = module.newest('/tasks', Tasks, asks=False)
    report = module.newest('/monitor/fleet', FleetReport, asks=False)
    profiles = module.newest('/execution_profiles', ExecutionProfiles, asks=False)
    costs = module.newest('/costs', Costs)
    assignments = module.speaker('/assignments')

    def allocate() -> None:
        assignments.say(
            allocator.allocate(
                tasks.value, report.value, costs.value, profiles.value, module.now_s()
            )
        )

    module.work_on(allocate, tasks, report, profiles, costs)
