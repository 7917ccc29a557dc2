"""What the bridge calls of rcl itself, ROS 2's library in C, where rclpy has no binding for it.

Its interface is the same from Humble to Rolling. A function that is called from a thread of DDS is
one of C, too: DDS holds the lock of a reader meanwhile, and a function of Python would wait there
for the interpreter, which another thread holds that waits for the lock (rclpy's issue 1722).
"""

import ctypes
from typing import Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from ros2_kafka_bridge.threads.wakeup import Wakeup

_ADDRESS: Final = ctypes.c_void_p
_ADDRESS_BYTES: Final = 8


def is_there() -> bool:
    """Whether rcl has all that is called of it here, and the C library has its eventfd."""
    if ctypes.sizeof(_ADDRESS) != _ADDRESS_BYTES:
        return False  # a callback's arguments would lie elsewhere than those of `eventfd_write`
    try:
        _rcl()
        _ring()
    except (OSError, AttributeError):
        return False
    return True


def notify(subscription: Any, wakeup: Wakeup) -> bool:
    """Ring whenever a message comes, and once for those that are there; False: it does not.

    Args:
        subscription: That of rclpy.
        wakeup: Has to outlive the subscription, or a call of `notify_nobody`.
    """
    return is_there() and _set_callback(subscription, _ring(), wakeup.descriptor)


def notify_nobody(subscription: Any) -> bool:
    """Ring no more: where it is True, no thread of DDS does by then."""
    return is_there() and _set_callback(subscription, None, None)


def _set_callback(subscription: Any, callback: Any, user_data: int | None) -> bool:
    with subscription.handle:
        place = subscription.handle.pointer
        return not _rcl().rcl_subscription_set_on_new_message_callback(place, callback, user_data)


class GraphChanges:
    """Waits until something changes in the ROS graph.

    Args:
        node: In that graph, as rclpy has it.
        context: Its context.
    """

    def __init__(self, node: Any, context: Any) -> None:
        self._node = node
        self._rcl = _rcl()
        self._wait_set = _rclpy.WaitSet(0, 2, 0, 0, 0, 0, context.handle)
        self._end = _rclpy.GuardCondition(context.handle)

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has changed since the last call, or this is to end.

        Returns:
            Whether something has changed.
        """
        self._wait_set.clear_entities()
        with self._node.handle:
            changes = self._rcl.rcl_node_get_graph_guard_condition(self._node.handle.pointer)
            if self._rcl.rcl_wait_set_add_guard_condition(self._wait_set.pointer, changes, None):
                raise OSError('rcl does not wait for changes of the graph')
            self._wait_set.add_guard_condition(self._end)
            self._wait_set.wait(int(timeout_s * 1e9))
            return bool(self._wait_set.is_ready('guard_condition', 0))

    def end(self) -> None:
        """End the wait, this one or the next."""
        self._end.trigger_guard_condition()


def _rcl() -> ctypes.CDLL:
    """The library that rclpy has loaded, by its name.

    Raises:
        OSError: There is none of that name.
        AttributeError: It lacks something.
    """
    rcl = ctypes.CDLL('librcl.so')
    rcl.rcl_node_get_graph_guard_condition.argtypes = [_ADDRESS]
    rcl.rcl_node_get_graph_guard_condition.restype = _ADDRESS
    rcl.rcl_wait_set_add_guard_condition.argtypes = [_ADDRESS, _ADDRESS, _ADDRESS]
    # The callback gets a pointer and a number: `eventfd_write`, a descriptor and a number.
    rcl.rcl_subscription_set_on_new_message_callback.argtypes = [_ADDRESS, _ADDRESS, _ADDRESS]
    return rcl


def _ring() -> Any:
    return ctypes.cast(ctypes.CDLL(None).eventfd_write, _ADDRESS)
