"""Cost Estimator: says what each task would cost each robot."""

from warehouse.domain.cost_estimator import CostEstimator
from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.messages.monitor import FleetReport
from warehouse.messages.tasks import Tasks
from warehouse.nodes.node import Module


def start(module: Module) -> None:
    """Estimate when tasks, robots or profiles have changed."""
    estimator = CostEstimator(module.site)
    tasks = module.newest('/tasks', Tasks)
    report = module.newest('/monitor/fleet', FleetReport)
    profiles = module.newest('/execution_profiles', ExecutionProfiles)
    costs = module.speaker('/costs')

    def estimate() -> None:
        costs.say(estimator.estimate(tasks.value, report.value, profiles.value, module.now_s()))

    module.work_on(estimate, tasks, report, profiles)
