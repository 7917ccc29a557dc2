"""What the bridge calls of rcl itself, ROS 2's library in C: what rclpy lacks, or makes dear.

The functions are the same from Humble to Rolling; what a take tells is laid out so since Iron, and
`probe.py` tries it. A function that is called from a thread of DDS is one of C, too: DDS holds the
lock of a reader meanwhile, and a function of Python would wait there for the interpreter, which
another thread holds that waits for the lock (rclpy's issue 1722).
"""

import ctypes
import struct
import sys
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.threads.wakeup import Wakeup

_ADDRESS: Final = ctypes.c_void_p
_ADDRESS_BYTES: Final = 8

# Two structures behind each other: rcutils_uint8_array_t, of which is read where the message lies
# and how long it is; and rmw_message_info_t (rmw/types.h, since Iron), of which when it was sent,
# its number and its publisher.
_TAKEN: Final = struct.Struct('=QQ48xq8xQ16x16s')
_INFO_AT: Final = 64
_TAKEN_BYTES: Final = 320  # more than they have
_ROOM: Final = ctypes.c_char * 65_536  # for a larger message rcl makes more
_NOTHING_THERE: Final = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED

Take = Callable[[int], tuple[list[Message], bool]]
"""Takes at most so many messages that are there, without waiting; tells also whether nothing was
left behind them. Where the middleware fails in the middle, the next call tells."""


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t: four functions and what they get."""

    _fields_ = (('functions', _ADDRESS * 4), ('state', _ADDRESS))


def is_there() -> bool:
    """Whether rcl has all that is called of it here, and the C library has its eventfd."""
    if ctypes.sizeof(_ADDRESS) != _ADDRESS_BYTES:
        return False  # what a take tells lies elsewhere, and a callback's arguments do
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


def make_take(subscription: Any, otherwise: Take, most_bytes: int = sys.maxsize) -> Take:
    """Make what takes the messages of a subscription with one call of rcl for each.

    rclpy makes two dicts and a buffer for each message, which cost more than the take itself.

    Args:
        subscription: That of rclpy.
        otherwise: Asked where rcl fails, so that it tells why.
        most_bytes: With how much a take ends.

    Raises:
        OSError: There is no rcl as the bridge knows it.
        AttributeError: It lacks something.
    """
    if not is_there():
        raise OSError('there is no rcl here as the bridge knows it, of 64 bits')
    # `PyDLL` keeps the interpreter during a call, as rclpy does: it would change hands for each.
    rcl, utils = ctypes.PyDLL('librcl.so'), ctypes.PyDLL('librcutils.so')
    take_one, reset = rcl.rcl_take_serialized_message, utils.rcutils_reset_error
    begin, end = utils.rcutils_uint8_array_init, utils.rcutils_uint8_array_fini
    utils.rcutils_get_default_allocator.restype = _Allocator
    memory = ctypes.byref(utils.rcutils_get_default_allocator())
    told = ctypes.create_string_buffer(_TAKEN_BYTES)
    into, info, handle = ctypes.byref(told), ctypes.byref(told, _INFO_AT), subscription.handle
    read, new = _TAKEN.unpack_from, partial(tuple.__new__, Message)
    room = ctypes.sizeof(_ROOM)

    def take(limit: int) -> tuple[list[Message], bool]:
        taken: list[Message] = []
        status, left_bytes = 0, most_bytes
        with handle:
            if begin(into, ctypes.c_size_t(room), memory):
                return otherwise(limit)
            try:
                subscribed, place = _ADDRESS(handle.pointer), read(told)[0]
                buffer = _ROOM.from_address(place)
                while len(taken) < limit and left_bytes > 0:
                    if status := take_one(subscribed, into, info, None):
                        break
                    at, length, made_ns, seq, gid = read(told)
                    in_place = at == place and length <= room  # `string_at` costs a call more
                    cdr = buffer[:length] if in_place else ctypes.string_at(at, length)
                    taken.append(new((cdr, gid, seq, made_ns)))
                    left_bytes -= length
            finally:
                end(into)  # it is as large as the largest one
        if status and status != _NOTHING_THERE:
            reset()
            return (taken, False) if taken else otherwise(limit)
        return taken, bool(status)

    return take


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
