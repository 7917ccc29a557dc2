"""The one use of rclpy's inner API: waiting, taking and counting matches without an executor.

The calls are those of rclpy's own `wait_for_message` and `EventHandler`, the same from Humble to
Rolling. `probe.py` tries them at start, so that a release that changes them is named and not met
in the middle of the traffic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import QoSPublisherEventType
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

if TYPE_CHECKING:
    from rclpy.client import Client
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

Taken = tuple[bytes, Mapping[str, Any]]
"""CDR bytes and what the middleware says of them."""


class Waiter:
    """Waits for messages of a set of subscriptions."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._size = 0
        self._wait_set: Any = None

    def wait(self, subscriptions: Sequence[Subscription[Any]], timeout_s: float) -> None:
        """Return when one of the subscriptions has a message, at the latest after `timeout_s`."""
        if self._wait_set is None or len(subscriptions) > self._size:
            self._size = len(subscriptions)
            self._wait_set = _rclpy.WaitSet(self._size, 0, 0, 0, 0, 0, self._context.handle)
        # One that has failed may hold what is destroyed by then: the next call makes another.
        wait_set, self._wait_set = self._wait_set, None
        wait_set.clear_entities()
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        wait_set.wait(int(timeout_s * 1e9))
        self._wait_set = wait_set


def take(subscription: Subscription[Any], limit: int) -> tuple[list[Taken], bool]:
    """Take at most `limit` messages that are there, without waiting.

    Where the middleware fails in the middle, what was taken is returned; the next call tells.

    Returns:
        The messages, and whether nothing was left behind them.
    """
    taken: list[Any] = []
    handle, message_type = subscription.handle, subscription.msg_type
    with handle:
        try:
            for _ in range(limit):
                one = handle.take_message(message_type, True)  # noqa: FBT003 (raw: its signature)
                if one is None:
                    return taken, True
                taken.append(one)
        except _rclpy.RCLError:
            if not taken:
                raise
    return taken, False


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
