"""What the modules say to each other, as JSON: the words of VDA 5050 where it has one.

Every message that holds a state is a snapshot: the whole state of its module, which the next one
replaces. Whoever starts later, or again, needs only the newest. `step` is the step of the fleet
(`FleetState.step`) that a snapshot reflects.

Cells are (column, row), counted from 0 at the top left; one cell is one metre, unless the site
says otherwise. Times that end in `_s` are seconds since the epoch, or since the start of a
simulation. JSON spells fields in camel case.
"""

from warehouse.messages.message import Cell, Message, node_cell, node_id
from warehouse.messages.monitor import (
    Blocked,
    FailureEvent,
    FleetReport,
    OperatorCommand,
    RobotReport,
)
from warehouse.messages.onlookers import Plan, Plans, ValidatorReport, Violation
from warehouse.messages.orders import (
    ORDER_ENDS,
    Line,
    LineStatus,
    OpenOrders,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)
from warehouse.messages.robots import (
    Action,
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    FleetOrders,
    FleetState,
    InstantAction,
    InstantActions,
    Load,
    OrderNode,
    Position,
    PowerSupply,
    RobotOrder,
    RobotState,
    SafetyState,
)
from warehouse.messages.tasks import (
    TASK_ENDS,
    Assignment,
    Assignments,
    Costs,
    Task,
    Tasks,
    TaskStatus,
)

__all__ = [
    'ORDER_ENDS',
    'TASK_ENDS',
    'Action',
    'ActionState',
    'ActionStatus',
    'Assignment',
    'Assignments',
    'Blocked',
    'Cell',
    'Costs',
    'Error',
    'ErrorLevel',
    'FailureEvent',
    'FleetOrders',
    'FleetReport',
    'FleetState',
    'InstantAction',
    'InstantActions',
    'Line',
    'LineStatus',
    'Load',
    'Message',
    'OpenOrders',
    'OperatorCommand',
    'Order',
    'OrderEvent',
    'OrderLine',
    'OrderNode',
    'OrderRequest',
    'OrderStatus',
    'Plan',
    'Plans',
    'Position',
    'PowerSupply',
    'RobotOrder',
    'RobotReport',
    'RobotState',
    'SafetyState',
    'Task',
    'TaskStatus',
    'Tasks',
    'ValidatorReport',
    'Violation',
    'node_cell',
    'node_id',
]
