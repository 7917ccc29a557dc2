"""The use of rclpy's inner API: taking and counting matches without an executor.

The calls are those of rclpy's own `wait_for_message` and `EventHandler`, the same from Humble to
Rolling. `probe.py` tries them at start, so that a release that changes them is named and not met
in the middle of the traffic.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rclpy.event_handler import QoSPublisherEventType
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.ros import rcl

if TYPE_CHECKING:
    from rclpy.client import Client
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

Taken = tuple[bytes, Mapping[str, Any]]
"""CDR bytes and what the middleware says of them."""

_LONG_NS: Final = 10_000_000_000
_ANSWER_S: Final = 5.0


def take(
    subscription: Subscription[Any], limit: int, most_bytes: int = sys.maxsize
) -> tuple[list[Taken], bool]:
    """Take at most `limit` messages that are there, without waiting; none behind `most_bytes`.

    Where the middleware fails in the middle, what was taken is returned; the next call tells.

    Returns:
        The messages, and whether nothing was left behind them.
    """
    taken: list[Any] = []
    handle, message_type = subscription.handle, subscription.msg_type
    with handle:
        try:
            while len(taken) < limit and most_bytes > 0:
                one = handle.take_message(message_type, True)  # noqa: FBT003 (raw: its signature)
                if one is None:
                    return taken, True
                taken.append(one)
                most_bytes -= len(one[0])
        except _rclpy.RCLError:
            if not taken:
                raise
    return taken, False


def make_take(
    subscription: Subscription[Any],
    most_bytes: int = sys.maxsize,
    *,
    has_gid: bool,
    by_rcl: bool,
) -> rcl.Take:
    """Make what takes the messages of a subscription.

    Args:
        subscription: Whose messages are taken as bytes.
        most_bytes: With how much a take ends.
        has_gid: Whether the middleware tells the publisher and the number of a message.
        by_rcl: Whether rcl itself may be called: it tells the same of a message as rclpy.
    """
    read = _told if has_gid else _untold

    def by_rclpy(limit: int) -> tuple[list[Message], bool]:
        taken, is_empty = take(subscription, limit, most_bytes)
        return [read(*one) for one in taken], is_empty

    if by_rcl and has_gid:
        return rcl.make_take(subscription, by_rclpy, most_bytes)
    return by_rclpy


def is_told_by_rcl(subscription: Subscription[Any], before: Taken) -> bool:
    """Whether rcl itself tells the same of messages as rclpy, by one that comes now.

    Args:
        subscription: Whose next message is the same as the one before, and of the same publisher.
        before: That one, as rclpy has taken it.
    """
    try:
        one = _told(*before)
        take_one = rcl.make_take(subscription, lambda _: ([], True))
        until_s = time.monotonic() + _ANSWER_S
        while not (taken := take_one(1)[0]) and time.monotonic() < until_s:
            time.sleep(0.002)
        [next_one] = taken
        since_ns = abs(next_one.source_time_ns - one.source_time_ns)
        same = one._replace(seq=one.seq + 1, source_time_ns=next_one.source_time_ns)
    except (OSError, AttributeError, KeyError, TypeError, ValueError):
        return False  # there is no such rcl, or the middleware does not tell all of it
    return next_one == same and since_ns < _LONG_NS


def _told(cdr: bytes, info: Mapping[str, Any]) -> Message:
    return Message(
        cdr,
        info['publisher_gid']['data'],
        info['publication_sequence_number'],
        info['source_timestamp'],
    )


def _untold(cdr: bytes, info: Mapping[str, Any]) -> Message:
    """Read a message of a ROS that does not tell its publisher, and perhaps not its number."""
    seq = info.get('publication_sequence_number') or 0
    return Message(cdr, b'', seq, info['source_timestamp'])


def take_answer(client: Client[Any, Any]) -> Any:
    """Take the answer of a service, where it is there; None where it is not yet."""
    with client.handle:
        return client.handle.take_response(client.srv_type.Response)[1]


class MatchEvents:
    """Counts the readers of a publisher that have come so far; no flicker goes unseen."""

    def __init__(self, publisher: Publisher[Any]) -> None:
        with publisher.handle:
            self._event: Any = _rclpy.EventHandle(
                publisher.handle, QoSPublisherEventType.RCL_PUBLISHER_MATCHED
            )

    def look(self) -> tuple[int, int]:
        """Return how many readers are matched now, and how many have come since the start."""
        with self._event:
            status = self._event.take_event()
        return status.current_count, status.total_count

    def close(self) -> None:
        """Let the event go."""
        self._event.destroy_when_not_in_use()
