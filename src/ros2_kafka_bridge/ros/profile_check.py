"""Whether Fast DDS uses the profile that it was shown: it takes a file as a whole, or not at all.

It says so in lines of its own only, and goes on with its defaults: without a bound for a history,
and without what the user has set. So a topic of no other use has a setting in that file, which is
looked for in the graph.
"""

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros.fastdds_profile import MARK_S

if TYPE_CHECKING:
    from collections.abc import Sequence

# In each container the first process is number 1.
_PROCESS: Final = os.urandom(4).hex()
_SHOWN_S: Final = 2.0
_WORDS: Final = 'its own words stand before this, the first XMLPARSER Error says what to mend'


class NodeView(Protocol):
    """A node, and what it sees."""

    handle: Any

    def publishers(self, topic: str) -> 'Sequence[Any]':
        """Who publishes there, with the QoS."""


def check_topic() -> str:
    """The topic of this process, the same each time: Fast DDS reads a file once."""
    return f'/_ros2_kafka_bridge/profile_{os.getpid()}_{_PROCESS}'


def check_profile(node: NodeView, file: Path | None) -> None:
    """Refuse a Fast DDS that has not taken the profile.

    Args:
        node: Made while the profile was shown, or after another one of this process was.
        file: Of the user, whose mistake it can only be.

    Raises:
        ConfigError: It names the file.
    """
    if _lifespan_ns(node) in {None, MARK_S * 10**9}:
        return
    if file is None:
        text = (
            f'Fast DDS does not use the settings of the bridge: {_WORDS}; without such '
            'words something has started ROS in this process before the bridge'
        )
        raise ConfigError([text])
    text = (
        f'{file}: Fast DDS refuses this DDS profile, and with it what the bridge needs '
        f'beside it: {_WORDS}'
    )
    raise ConfigError([text])


def _lifespan_ns(node: NodeView) -> int | None:
    """How long the samples live of a writer of that topic, as the graph shows it.

    None where it shows no such writer: with its defaults Fast DDS shows it at once, so that
    something in the profile counts, such as no discovery.
    """
    from builtin_interfaces.msg import Time  # noqa: PLC0415 (heavy, and loaded with rclpy)

    publisher = node.handle.create_publisher(Time, check_topic(), 1)
    try:
        until_s = time.monotonic() + _SHOWN_S
        while time.monotonic() < until_s:
            if told := node.publishers(check_topic()):
                return max(int(peer.qos.lifespan.nanoseconds) for peer in told)
            time.sleep(0.01)
    finally:
        node.handle.destroy_publisher(publisher)
    return None
