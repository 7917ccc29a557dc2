"""The one use of rclpy's inner API: taking and counting matches without an executor.

The calls are those of rclpy's own `wait_for_message` and `EventHandler`, the same from Humble to
Rolling. `probe.py` tries them at start, so that a release that changes them is named and not met
in the middle of the traffic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import QoSPublisherEventType
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

if TYPE_CHECKING:
    from rclpy.client import Client
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

Taken = tuple[bytes, Mapping[str, Any]]
"""CDR bytes and what the middleware says of them."""


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
