"""The topics of the warehouse: who says what to whom. The drawing in the docs is made of it."""

from typing import Final, NamedTuple

STRING: Final = 'std_msgs/msg/String'


class Topic(NamedTuple):
    """A ROS topic.

    Attributes:
        name: With `<robot>` where each robot has its own.
        content: The message in JSON (`ros2_kafka_warehouse.messages`, or a value of the domain) of
            a String, or what a message of another type holds.
        latched: TRANSIENT_LOCAL: who comes later gets the newest ten, the oldest of them first.
        history: TRANSIENT_LOCAL and KEEP_ALL: events that a bridge which was away gets, too.
    """

    name: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    content: str
    type: str = STRING
    latched: bool = False
    history: bool = False


class KafkaTopic(NamedTuple):
    """A Kafka topic and the ROS topic that the bridge joins it with."""

    name: str
    ros: str
    to_ros: bool
    compacted: bool = False


BRIDGE: Final = 'bridge'  # the node that joins Kafka

TOPICS: Final = (
    Topic('/orders/incoming', (BRIDGE,), ('orders',), 'OrderRequest'),
    Topic(
        '/orders/open',
        ('orders',),
        ('task_organizer', 'validator', BRIDGE),
        'OpenOrders',
        latched=True,
    ),
    Topic('/orders/events', ('orders',), (BRIDGE,), 'OrderEvent', history=True),
    Topic(
        '/tasks',
        ('task_organizer',),
        (
            'orders',
            'cost_estimator',
            'task_allocator',
            'path_planner',
            'monitor',
            'validator',
            BRIDGE,
        ),
        'Tasks',
        latched=True,
    ),
    Topic(
        '/costs', ('cost_estimator',), ('task_allocator', 'task_organizer'), 'Costs', latched=True
    ),
    Topic(
        '/assignments',
        ('task_allocator',),
        ('path_planner', 'task_organizer', 'orders', BRIDGE),
        'Assignments',
        latched=True,
    ),
    Topic('/robots/orders', ('path_planner',), ('robots', 'monitor'), 'FleetOrders'),
    Topic('/robots/instant_actions', ('monitor',), ('robots',), 'InstantActions'),
    Topic(
        '/robots/state',
        ('robots',),
        ('task_organizer', 'path_planner', 'monitor', 'validator', BRIDGE),
        'FleetState',
        latched=True,
    ),
    Topic(
        '/monitor/fleet',
        ('monitor',),
        (
            'task_organizer',
            'cost_estimator',
            'task_allocator',
            'path_planner',
            'robots',
            'validator',
            BRIDGE,
        ),
        'FleetReport',
        latched=True,
    ),
    Topic('/monitor/failures', ('monitor',), (BRIDGE,), 'FailureEvent', history=True),
    Topic(
        '/execution_profiles',
        ('execution_profiles',),
        (
            'task_organizer',
            'cost_estimator',
            'task_allocator',
            'path_planner',
            'robots',
            'monitor',
            'validator',
        ),
        'ExecutionProfiles',
        latched=True,
    ),
    Topic(
        '/robot_failure_profile',
        ('robot_failure_profile',),
        ('monitor',),
        'RobotFailureProfile',
        latched=True,
    ),
    Topic('/operator/commands', (BRIDGE,), ('robots', 'monitor'), 'OperatorCommand'),
    Topic('/path_planner/plans', ('path_planner',), (BRIDGE,), 'Plans', latched=True),
    Topic(
        '/validator/report', ('validator',), ('monitor', BRIDGE), 'ValidatorReport', latched=True
    ),
    Topic(
        '/map',
        ('path_planner',),
        (),
        'the grid, with what is blocked',
        'nav_msgs/msg/OccupancyGrid',
        latched=True,
    ),
    Topic('/<robot>/path', ('path_planner',), (), 'its way', 'nav_msgs/msg/Path', latched=True),
    Topic('/<robot>/pose', ('robots',), (), 'where it is', 'geometry_msgs/msg/PoseStamped'),
    Topic(
        '/<robot>/battery_state', ('robots',), (), 'its battery', 'sensor_msgs/msg/BatteryState'
    ),
    Topic(
        '/diagnostics',
        ('monitor',),
        (),
        'a status for each robot',
        'diagnostic_msgs/msg/DiagnosticArray',
    ),
)

KAFKA: Final = (
    KafkaTopic('warehouse.orders', '/orders/incoming', to_ros=True),
    KafkaTopic('warehouse.commands', '/operator/commands', to_ros=True),
    KafkaTopic('warehouse.order-events', '/orders/events', to_ros=False),
    KafkaTopic('warehouse.failures', '/monitor/failures', to_ros=False),
    KafkaTopic('warehouse.open-orders', '/orders/open', to_ros=False, compacted=True),
    KafkaTopic('warehouse.tasks', '/tasks', to_ros=False, compacted=True),
    KafkaTopic('warehouse.assignments', '/assignments', to_ros=False, compacted=True),
    KafkaTopic('warehouse.robots', '/robots/state', to_ros=False, compacted=True),
    KafkaTopic('warehouse.fleet', '/monitor/fleet', to_ros=False, compacted=True),
    KafkaTopic('warehouse.plans', '/path_planner/plans', to_ros=False, compacted=True),
    KafkaTopic('warehouse.validator', '/validator/report', to_ros=False, compacted=True),
)
