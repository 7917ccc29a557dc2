"""Cost Estimator: says what each task would cost each robot."""

from ros2_kafka_warehouse.domain.cost_estimator import CostEstimator
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.tasks import Tasks
from ros2_kafka_warehouse.nodes.node import Module


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
