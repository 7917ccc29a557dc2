"""What the ends in ROS have in common."""

import importlib
import time
from collections.abc import Iterable
from typing import Any, Final

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

_SETTLE_S: Final = 1.0  # a writer knows of a match before its reader does


def qos(durability: str = 'volatile', reliability: str = 'reliable', depth: int = 0) -> QoSProfile:
    """What a user asks for; `depth` is that of KEEP_LAST, 0 is KEEP_ALL."""
    return QoSProfile(
        reliability=ReliabilityPolicy[reliability.upper()],
        durability=DurabilityPolicy[durability.upper()],
        history=HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL,
        depth=depth,
    )


def kind_of(message_type: str) -> Any:
    """The class of a message type, from its package."""
    package, _, name = message_type.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def wait_for_readers(publishers: Iterable[Any], count: int = 1) -> None:
    """Wait until each has so many, and they know of it; not at all for none."""
    for publisher in publishers:
        while publisher.get_subscription_count() < count:
            time.sleep(0.01)
    if count:
        time.sleep(_SETTLE_S)


def has_published(publisher: Any, message: Any) -> bool:
    """Publish a message; False where the history is full."""
    try:
        publisher.publish(message)
    except Exception as error:
        if 'cannot publish data' not in str(error):
            raise
        return False
    return True
