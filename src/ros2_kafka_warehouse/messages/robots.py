"""Robots: orders to them and states from them, in the terms of VDA 5050."""

from enum import StrEnum

from msgspec import field

from ros2_kafka_warehouse.messages.message import Cell, Message, node_cell


class Action(Message, frozen=True):
    """`pick`, `drop` or `startCharging`, done at the node where it stands.

    `action_id` is `<task_id>#<attempt>:pick` or `...:drop`, or names the charge.
    """

    action_id: str
    action_type: str
    load_id: str = ''  # the task's id
    product: str = ''
    weight_kg: float = 0.0
    source: Cell | None = None  # where the load is, if not on the node itself


class OrderNode(Message, frozen=True):
    """A node of an order; the robot may drive to it when it is released."""

    node_id: str
    sequence_id: int
    released: bool = True
    actions: tuple[Action, ...] = ()


class RobotOrder(Message, frozen=True):
    """The order for one robot: the node where it stands, the next one, and a horizon.

    The release of a node holds for one step: what the robot could not begin lapses, and the next
    order says anew.
    """

    serial_number: str
    order_id: str
    order_update_id: int
    nodes: tuple[OrderNode, ...]


class FleetOrders(Message, frozen=True):
    """`/robots/orders`: what the robots may do next, all planned on the state of `step`.

    Robots that are not named stay where they are. It is void once any robot has moved since.
    """

    step: int
    orders: tuple[RobotOrder, ...] = ()


class InstantAction(Message, frozen=True):
    """To be done at once: `startPause`, `stopPause`, `cancelOrder`, `retry`, `stopCharging`."""

    serial_number: str
    action_id: str
    action_type: str


class InstantActions(Message, frozen=True):
    """`/robots/instant_actions`."""

    actions: tuple[InstantAction, ...]


class ActionStatus(StrEnum):
    """How far an action is."""

    WAITING = 'WAITING'
    INITIALIZING = 'INITIALIZING'
    RUNNING = 'RUNNING'
    PAUSED = 'PAUSED'
    RETRIABLE = 'RETRIABLE'
    FINISHED = 'FINISHED'
    FAILED = 'FAILED'


class ActionState(Message, frozen=True):
    """An action of the robot: of its order now, and the last ten that have ended."""

    action_id: str
    action_type: str
    action_status: ActionStatus
    result_description: str = ''


class Load(Message, frozen=True):
    """A load on a robot."""

    load_id: str
    load_type: str = ''
    weight: float = 0.0


class Position(Message, frozen=True):
    """Where the robot believes to be: metres from the top left; `theta` in radians."""

    x: float
    y: float
    theta: float = 0.0
    localized: bool = True
    map_id: str = ''


class PowerSupply(Message, frozen=True):
    """The battery; `state_of_charge` in percent."""

    state_of_charge: float
    charging: bool = False


class SafetyState(Message, frozen=True):
    """`active_emergency_stop`: MANUAL, REMOTE or NONE."""

    active_emergency_stop: str = 'NONE'
    field_violation: bool = False


class ErrorLevel(StrEnum):
    """How much an error hinders (VDA 5050, 6.6.5.1)."""

    WARNING = 'WARNING'
    URGENT = 'URGENT'
    CRITICAL = 'CRITICAL'
    FATAL = 'FATAL'


class Error(Message, frozen=True):
    """What a robot reports of itself; `error_references` as key and value."""

    error_type: str
    error_level: ErrorLevel
    error_description: str = ''
    error_hint: str = ''
    error_references: tuple[tuple[str, str], ...] = ()


class RobotState(Message, frozen=True):
    """The state of one robot (VDA 5050, 6.6).

    `last_node_id` is the cell that it holds; while it drives, it holds the cell in `node_states`,
    too.
    """

    header_id: int
    serial_number: str
    robot_type: str
    last_node_id: str
    position: Position
    power_supply: PowerSupply
    order_id: str = ''
    order_update_id: int = 0
    last_node_sequence_id: int = 0
    driving: bool = False
    paused: bool = False
    node_states: tuple[str, ...] = ()
    action_states: tuple[ActionState, ...] = ()
    loads: tuple[Load, ...] = ()
    errors: tuple[Error, ...] = ()
    safety_state: SafetyState = SafetyState()
    operating_mode: str = 'AUTOMATIC'

    @property
    def cell(self) -> Cell:
        """The cell that it holds."""
        return node_cell(self.last_node_id)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells that it holds: one, or two while it drives."""
        if not self.driving:
            return (self.cell,)
        return (self.cell, *(node_cell(node) for node in self.node_states[:1]))


class FleetState(Message, frozen=True):
    """`/robots/state`: the robots that are heard of, at one step.

    `floor` is the simulation's own memory: what stands where (pallets, loads on the floor, faults
    that nothing shows), for a simulation that starts again. No module that decides anything may
    read it; the validator does, to judge whether a robot drove through a pallet.
    """

    step: int
    states: tuple[RobotState, ...] = ()
    floor: dict[str, str] = field(default_factory=dict)
