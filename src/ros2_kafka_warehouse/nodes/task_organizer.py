"""Task Organizer: says the tasks of the open orders, and how far each of them is."""

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.task_organizer import TaskOrganizer
from ros2_kafka_warehouse.messages.monitor import FleetReport
from ros2_kafka_warehouse.messages.orders import OpenOrders
from ros2_kafka_warehouse.messages.robots import FleetState
from ros2_kafka_warehouse.messages.tasks import Assignments, Costs
from ros2_kafka_warehouse.nodes.node import Module


def start(module: Module) -> None:
    """Follow every state of the fleet, and what the others say of orders and robots."""
    organizer = TaskOrganizer(module.site)
    orders = module.newest('/orders/open', OpenOrders)
    report = module.newest('/monitor/fleet', FleetReport)
    profiles = module.newest('/execution_profiles', ExecutionProfiles)
    costs = module.newest('/costs', Costs)
    assignments = module.newest('/assignments', Assignments)
    states = module.queue('/robots/state', FleetState)
    tasks = module.speaker('/tasks')

    def organize() -> None:
        organizer.take(orders.value)
        for state in states.take():
            organizer.follow(
                state,
                report.or_none,
                costs.or_none,
                assignments.or_none,
                profiles.value,
            )
        tasks.say(organizer.tasks())

    module.work_on(organize, orders, report, profiles, states)
