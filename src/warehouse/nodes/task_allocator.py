"""Task Allocator: says which robot does which tasks, and in which order."""

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.task_allocator import TaskAllocator
from warehouse.messages.monitor import FleetReport
from warehouse.messages.tasks import Costs, Tasks
from warehouse.nodes.node import Module


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
