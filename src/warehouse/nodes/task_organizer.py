"""Task Organizer: says the tasks of the open orders, and how far each of them is."""

from warehouse.domain.execution_profiles import ExecutionProfiles
from warehouse.domain.task_organizer import TaskOrganizer
from warehouse.messages.monitor import FleetReport
from warehouse.messages.orders import OpenOrders
from warehouse.messages.robots import FleetState
from warehouse.messages.tasks import Assignments, Costs
from warehouse.nodes.node import Module


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
