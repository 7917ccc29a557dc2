"""Publishers and readers in ROS, as bridges that take turns at a route meet them."""

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.ros.node import node_name
from ros2_kafka_bridge.ros.peer import Peer

if TYPE_CHECKING:
    from support.worlds.handover_bridges import Bridge

NEVER: Final = float('inf')
KNOWN_S: Final = 3.5
"""So long after a reader has come a publisher may still send nothing to it."""

BRIDGE: Final = 'b'
HEARTBEAT_S: Final = 3.0
"""A publisher sends again what had no room, after so long at most."""

LATE_HEARTBEAT_S: Final = 9.0
"""The same to a process that has stood still."""

LEASE_S: Final = 20.0
"""So long at most ROS shows a reader of a killed process."""


class Voice(NamedTuple):
    """How a publisher publishes.

    Args:
        every: How many ticks.
        ahead_s: Its clock is.
        silent_s: From when until when it publishes nothing.
    """

    every: int = 4
    ahead_s: float = 0.0
    silent_s: tuple[float, float] = (0.0, 0.0)


class Sent:
    """A message on its way."""

    def __init__(self, message: Message, at_s: float) -> None:
        self.message = message
        self.at_s = at_s
        self.readers: list[Reader] = []  # that the publisher knew
        self.is_taken = False


class Link:
    """What a publisher holds for a reader that it knows: in order, and again what had no room."""

    def __init__(self, known_at_s: float) -> None:
        self.known_at_s = known_at_s
        self.waiting: deque[Sent] = deque()
        self.again_at_s = 0.0


class Reader:
    """A reader of a bridge, and why it may lose something."""

    def __init__(self, bridge: 'Bridge', gid: bytes, links: Sequence[Link], room: int) -> None:
        self.bridge = bridge
        self.gid = gid
        self.links = links  # by their publishers
        self.cache: deque[Sent] = deque()
        self.room = room
        self.opened_at_s = bridge.world.now_s
        self.closed_at_s = self.gone_at_s = NEVER
        self.shown_at_s = 0.0
        self.excuse = ''
        self.late_excuse = ''  # for what was to come again
        self.newer_s = NEVER  # what is stamped so is taken for what the next one has
        self.waits_until_s = 0.0  # for the successor at most

    def flow(self, now_s: float) -> None:
        """Let what had no room come."""
        for link in self.links:
            if not link.waiting or now_s < link.again_at_s:
                continue
            size = min(len(link.waiting), self.room - len(self.cache))
            self.cache.extend(link.waiting.popleft() for _ in range(size))
            if size and link.waiting:  # the rest comes by and by
                link.again_at_s = now_s + self.bridge.world.upto(HEARTBEAT_S)

    def is_known_at(self, publisher: int, now_s: float) -> bool:
        """Whether a publisher sends to it."""
        return self.links[publisher].known_at_s <= now_s < self.closed_at_s


class Graph:
    """The ROS graph as a bridge sees it: its own readers at once."""

    def __init__(self, bridge: 'Bridge') -> None:
        self._bridge = bridge

    def publishers(self, _topic: str) -> list[Peer]:
        return [peer('/robot', b'')]

    def subscribers(self, _topic: str) -> list[Peer]:
        others = [it for it in self._bridge.world.shown() if it.bridge is not self._bridge]
        mine = [] if self._bridge.reader is None else [self._bridge.reader]
        shown = [*others, *mine]
        return [peer(f'/{node_name(BRIDGE)}', it.gid) for it in shown]


def peer(node: str, gid: bytes) -> Peer:
    return Peer(node, 't', gid, '', 'reliable', 'volatile', None)
