"""A Task Allocator of one's own, in plain rclpy: the cheapest pair of robot and task first.

It sends nobody to charge, which the warehouse's own does (`charger` of an assignment).

Run the warehouse without its own, `make warehouse A='--without task_allocator'`, and this beside.
"""

import json
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

# Ten: a latched writer that keeps one message can fall silent when a reader is killed.
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class GreedyAllocator(Node):
    """Hears `/costs`, says `/assignments`."""

    def __init__(self) -> None:
        super().__init__('task_allocator')
        self.assignments = self.create_publisher(String, '/assignments', LATCHED)
        self.create_subscription(String, '/costs', self.allocate, LATCHED)

    def allocate(self, message: String) -> None:
        """Give each robot at most one task."""
        costs = json.loads(message.data)
        pairs = sorted(
            (cost, robot, task)
            for robot, row in zip(costs.get('robots', ()), costs.get('costs', ()), strict=True)
            for task, cost in zip(costs['tasks'], row, strict=True)
            if cost is not None
        )
        given: dict[str, str] = {}
        for _, robot, task in pairs:
            if robot not in given and task not in given.values():
                given[robot] = task
        assignments = [{'serialNumber': robot, 'tasks': [task]} for robot, task in given.items()]
        answer = {'step': costs['step'], 'assignments': assignments}
        self.assignments.publish(String(data=json.dumps(answer)))


if __name__ == '__main__':
    with suppress(KeyboardInterrupt, ExternalShutdownException), rclpy.init():
        rclpy.spin(GreedyAllocator())
