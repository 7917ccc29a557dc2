"""All that the bridge uses of rclpy, in one table; and what of it the rclpy here does not have.

A user may source a ROS of any age. What a release has renamed or dropped is told at start by one
sentence, before anything is called. What a signature cannot show, `probe.py` tries.
"""

import dis
import inspect
from collections.abc import Iterator
from enum import Enum
from functools import reduce
from importlib import import_module
from typing import Any, Final, NamedTuple


class NeededBy(Enum):
    """Which part of the bridge needs something: the node of `monitoring:` is not always there."""

    ROUTES = 'routes'
    MANAGED_NODE = 'managed node'


class Used(NamedTuple):
    """Something of rclpy that the bridge uses.

    Args:
        module: As `rclpy.node`.
        name: As `Node.create_publisher`.
        positional: How many arguments the bridge passes by their place, beside self, where it is
            called; None where it could be and is not.
        named: Those that it passes by name, with a space between.
        part: What needs it.
    """

    module: str
    name: str
    positional: int | None = 0
    named: str = ''
    part: NeededBy = NeededBy.ROUTES

    def __str__(self) -> str:
        """Its whole name."""
        return f'{self.module}.{self.name}'


_C: Final = 'rclpy.impl.implementation_singleton'
_EVENTS: Final = 'rclpy.event_handler'
_LIFECYCLE: Final = 'rclpy.lifecycle.node'
_NODE: Final = 'rclpy.node'
_QOS: Final = 'rclpy.qos'
_MANAGED: Final = NeededBy.MANAGED_NODE

TABLE: Final = (
    # Joining the graph
    Used('rclpy', 'Context'),
    Used('rclpy', 'init', 0, 'args context domain_id signal_handler_options'),
    Used('rclpy', 'utilities.get_rmw_implementation_identifier'),
    Used(
        'rclpy',
        'create_node',
        1,
        'context use_global_arguments enable_rosout start_parameter_services parameter_overrides',
    ),
    Used('rclpy', 'Context.get_domain_id'),
    Used('rclpy', 'Context.handle'),
    Used('rclpy', 'Context.try_shutdown'),
    Used('rclpy.parameter', 'Parameter', 1, 'value'),
    Used('rclpy.signals', 'SignalHandlerOptions.NO'),
    Used(_NODE, 'Node.context'),
    Used(_NODE, 'Node.destroy_node'),
    # Looking at it
    Used(_NODE, 'Node.get_fully_qualified_name'),
    Used(_NODE, 'Node.get_name'),
    Used(_NODE, 'Node.get_publishers_info_by_topic', 1),
    Used(_NODE, 'Node.get_subscriptions_info_by_topic', 1),
    Used(_NODE, 'Node.get_topic_names_and_types'),
    Used(_NODE, 'TopicEndpointInfo.endpoint_gid'),
    Used(_NODE, 'TopicEndpointInfo.node_name'),
    Used(_NODE, 'TopicEndpointInfo.node_namespace'),
    Used(_NODE, 'TopicEndpointInfo.qos_profile'),
    Used(_NODE, 'TopicEndpointInfo.topic_type'),
    # QoS
    Used('rclpy.duration', 'Duration', 0, 'nanoseconds'),
    Used('rclpy.duration', 'Duration.nanoseconds'),
    Used(_QOS, 'DurabilityPolicy.TRANSIENT_LOCAL'),
    Used(_QOS, 'DurabilityPolicy.VOLATILE'),
    Used(_QOS, 'HistoryPolicy', None),
    Used(_QOS, 'LivelinessPolicy.AUTOMATIC'),
    Used(_QOS, 'LivelinessPolicy.MANUAL_BY_TOPIC'),
    Used(_QOS, 'QoSProfile', 0, 'depth reliability'),
    Used(_QOS, 'QoSProfile.deadline'),
    Used(_QOS, 'QoSProfile.durability'),
    Used(_QOS, 'QoSProfile.lifespan'),
    Used(_QOS, 'QoSProfile.liveliness'),
    Used(_QOS, 'QoSProfile.reliability'),
    Used(_QOS, 'ReliabilityPolicy.BEST_EFFORT'),
    Used(_QOS, 'ReliabilityPolicy.RELIABLE'),
    # Endpoints
    Used('rclpy.client', 'Client.call_async', 1),
    Used('rclpy.client', 'Client.handle'),
    Used('rclpy.client', 'Client.service_is_ready'),
    Used('rclpy.client', 'Client.srv_type'),
    Used('rclpy.publisher', 'Publisher.handle'),
    Used('rclpy.publisher', 'Publisher.publish', 1),
    Used('rclpy.publisher', 'Publisher.wait_for_all_acked', 1),
    Used('rclpy.subscription', 'Subscription.handle'),
    Used('rclpy.subscription', 'Subscription.msg_type'),
    Used('rclpy.type_support', 'check_is_valid_msg_type', 1),
    Used(_EVENTS, 'PublisherEventCallbacks', 0, 'use_default_callbacks'),
    Used(_EVENTS, 'QoSPublisherEventType.RCL_PUBLISHER_MATCHED'),
    Used(_EVENTS, 'SubscriptionEventCallbacks', 0, 'use_default_callbacks'),
    Used(_NODE, 'Node.create_client', 2),
    Used(_NODE, 'Node.create_publisher', 3, 'event_callbacks'),
    Used(_NODE, 'Node.create_subscription', 4, 'raw event_callbacks'),
    Used(_NODE, 'Node.destroy_client', 1),
    Used(_NODE, 'Node.destroy_publisher', 1),
    Used(_NODE, 'Node.destroy_subscription', 1),
    # Publishing bytes, and taking without an executor
    Used(_C, 'rclpy_implementation.Client.take_response', 1),
    Used(_C, 'rclpy_implementation.EventHandle', 2),
    Used(_C, 'rclpy_implementation.EventHandle.destroy_when_not_in_use'),
    Used(_C, 'rclpy_implementation.EventHandle.take_event'),
    Used(_C, 'rclpy_implementation.Publisher.publish_raw', 1),
    Used(_C, 'rclpy_implementation.RCLError'),
    Used(_C, 'rclpy_implementation.Subscription.pointer'),
    Used(_C, 'rclpy_implementation.Subscription.take_message', 2),
    # Waiting for changes of the graph
    Used(_C, 'rclpy_implementation.GuardCondition', 1),
    Used(_C, 'rclpy_implementation.GuardCondition.trigger_guard_condition'),
    Used(_C, 'rclpy_implementation.Node.pointer'),
    Used(_C, 'rclpy_implementation.WaitSet', 7),
    Used(_C, 'rclpy_implementation.WaitSet.add_guard_condition', 1),
    Used(_C, 'rclpy_implementation.WaitSet.clear_entities'),
    Used(_C, 'rclpy_implementation.WaitSet.is_ready', 2),
    Used(_C, 'rclpy_implementation.WaitSet.pointer'),
    Used(_C, 'rclpy_implementation.WaitSet.wait', 1),
    Used(_NODE, 'Node.handle'),
    # The node of `monitoring:`
    Used('rclpy.callback_groups', 'MutuallyExclusiveCallbackGroup', part=_MANAGED),
    Used('rclpy.callback_groups', 'ReentrantCallbackGroup', part=_MANAGED),
    Used('rclpy.clock', 'Clock.now', part=_MANAGED),
    Used('rclpy.executors', 'MultiThreadedExecutor', 1, 'context', _MANAGED),
    Used('rclpy.executors', 'MultiThreadedExecutor.add_node', 1, part=_MANAGED),
    Used('rclpy.executors', 'MultiThreadedExecutor.remove_node', 1, part=_MANAGED),
    Used('rclpy.executors', 'MultiThreadedExecutor.shutdown', part=_MANAGED),
    Used('rclpy.executors', 'MultiThreadedExecutor.spin_once', 0, 'timeout_sec', _MANAGED),
    Used('rclpy.lifecycle', 'LifecycleState.label', part=_MANAGED),
    Used('rclpy.lifecycle', 'TransitionCallbackReturn.ERROR', part=_MANAGED),
    Used('rclpy.lifecycle', 'TransitionCallbackReturn.FAILURE', part=_MANAGED),
    Used('rclpy.lifecycle', 'TransitionCallbackReturn.SUCCESS', part=_MANAGED),
    Used('rclpy.parameter', 'Parameter.name', part=_MANAGED),
    Used('rclpy.parameter', 'Parameter.value', part=_MANAGED),
    Used('rclpy.service', 'Service.callback', part=_MANAGED),
    Used('rclpy.time', 'Time.to_msg', part=_MANAGED),
    Used(_C, 'rclpy_implementation.LifecycleStateMachine.available_transitions', part=_MANAGED),
    Used(_C, 'rclpy_implementation.LifecycleStateMachine.current_state', part=_MANAGED),
    Used(_LIFECYCLE, 'LifecycleNodeMixin', 0, 'callback_group', _MANAGED),
    Used(
        _LIFECYCLE,
        'LifecycleNodeMixin._service_change_state',
        part=_MANAGED,
    ),
    Used(_LIFECYCLE, 'LifecycleNodeMixin._state_machine', part=_MANAGED),
    Used(_LIFECYCLE, 'LifecycleNodeMixin.trigger_activate', part=_MANAGED),
    Used(_LIFECYCLE, 'LifecycleNodeMixin.trigger_cleanup', part=_MANAGED),
    Used(_LIFECYCLE, 'LifecycleNodeMixin.trigger_configure', part=_MANAGED),
    Used(_LIFECYCLE, 'LifecycleNodeMixin.trigger_deactivate', part=_MANAGED),
    Used(_NODE, 'Node', 1, 'context cli_args use_global_arguments enable_rosout', _MANAGED),
    Used(_NODE, 'Node.add_on_set_parameters_callback', 1, part=_MANAGED),
    Used(_NODE, 'Node.create_service', 3, 'callback_group', _MANAGED),
    Used(_NODE, 'Node.declare_parameter', 3, 'ignore_override', _MANAGED),
    Used(_NODE, 'Node.describe_parameter', 1, part=_MANAGED),
    Used(_NODE, 'Node.destroy_service', 1, part=_MANAGED),
    Used(_NODE, 'Node.get_clock', part=_MANAGED),
    Used(_NODE, 'Node.get_namespace', part=_MANAGED),
    Used(_NODE, 'Node.get_node_names_and_namespaces', part=_MANAGED),
    Used(_NODE, 'Node.get_parameter', 1, part=_MANAGED),
    Used(_NODE, 'Node.set_parameters', 1, part=_MANAGED),
    Used(_NODE, 'Node.undeclare_parameter', 1, part=_MANAGED),
)
"""Each row is used by a file below `ros/`, and each use that a test knows by name has a row."""

_HANDED_OUT: Final = frozenset(
    {
        'rclpy.client.Client',
        'rclpy.clock.Clock',
        'rclpy.node.TopicEndpointInfo',  # its module has another name in newer ones
        'rclpy.publisher.Publisher',
        'rclpy.service.Service',
        'rclpy.subscription.Subscription',
        'rclpy.time.Time',
        f'{_C}.rclpy_implementation.Client',
        f'{_C}.rclpy_implementation.LifecycleStateMachine',
        f'{_C}.rclpy_implementation.Node',
        f'{_C}.rclpy_implementation.Publisher',
        f'{_C}.rclpy_implementation.Subscription',
    }
)
"""Classes of which the bridge gets objects: a release may put them elsewhere."""


def lacking(part: NeededBy) -> list[str]:
    """Tell what the rclpy that is loaded does not have for a part, or not as it is called.

    Raises:
        ImportError: rclpy itself lacks something of others.
    """
    return [said for row in TABLE if row.part is part for said in _lack(row)]


def _lack(row: Used) -> Iterator[str]:
    owner, last = _owner(row), row.name.rpartition('.')[2]
    if owner is None:
        if str(row).rpartition('.')[0] not in _HANDED_OUT:
            yield str(row)
    elif not hasattr(owner, last):
        if not (inspect.isclass(owner) and _is_set_on_objects(owner, last)):
            yield str(row)
    elif row.positional is not None:
        try:
            _try_call(row, owner, getattr(owner, last))
        except TypeError as error:
            yield f'{row} ({error})'


def _owner(row: Used) -> Any:
    """The module or class that should have something; None where that is not there itself."""
    try:
        return reduce(getattr, row.name.split('.')[:-1], import_module(row.module))
    except AttributeError:
        return None
    except ModuleNotFoundError as error:
        if str(error.name).startswith('rclpy.'):
            return None
        raise


def _try_call(row: Used, owner: Any, found: Any) -> None:
    """Bind the arguments of the bridge.

    Raises:
        TypeError: They do not fit.
    """
    is_class = inspect.isclass(found)
    if not inspect.isfunction(found.__init__ if is_class else found):
        return  # of C, it tells no signature, or one that counts in another way
    try:
        signature = inspect.signature(found)
    except ValueError:  # something between is of C
        return
    with_self = inspect.isclass(owner) and not is_class
    places = [None] * ((row.positional or 0) + with_self)
    signature.bind(*places, **dict.fromkeys(row.named.split()))


def _is_set_on_objects(owner: type, name: str) -> bool:
    """Whether objects get this: as a field, or by a method of the class or one below it."""
    if name in getattr(owner, '__dataclass_fields__', {}):
        return True
    held = (inspect.unwrap(value) for base in owner.__mro__ for value in vars(base).values())
    codes = (value.__code__ for value in held if inspect.isfunction(value))
    return any(
        (step.opname, step.argval) == ('STORE_ATTR', name)
        for code in codes
        if name in code.co_names
        for step in dis.get_instructions(code)
    )
