"""Each module of the warehouse as a ROS 2 node, in a file of its name.

A node is thin: it hears, asks its domain object, and says what has changed (`node.Module`).
"""

from typing import Final

MODULES: Final = (
    'execution_profiles',
    'robot_failure_profile',
    'monitor',
    'robots',
    'orders',
    'task_organizer',
    'cost_estimator',
    'task_allocator',
    'path_planner',
    'validator',
)
