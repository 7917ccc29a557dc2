"""Publishing to ROS, and knowing what has arrived."""

import logging
import math
import time
from typing import Any

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.endpoints import Load, Matches, Readers
from ros2_kafka_bridge.errors import BridgeError, blamed
from ros2_kafka_bridge.logs.lines import summed
from ros2_kafka_bridge.ros.errors import left_behind, translate, translated
from ros2_kafka_bridge.ros.node import Peer, RosNode
from ros2_kafka_bridge.ros.qos import mismatch, profile
from ros2_kafka_bridge.ros.types import MessageType

_AGE_S = 0.05
_GRAPH_S = 1.0
_NO_NODE = 'a reader that is no ROS node'
_SAME_VERSION = 'install the same version of the package on both sides'


class RosSink:
    """A `MessageSink` on a real topic.

    A KEEP_ALL history of `room` samples cannot overwrite: when message k was accepted, message
    k - room is acknowledged by every matched reader. At a pause, all are when the middleware says
    so. Where it bounds no history there would be no pause while messages flow: then no more than
    `room` are published until all are acknowledged.

    Acknowledged counts as confirmed only after it has aged with no reader going away: a reader
    that dies is forgotten by the history a moment before it is reported as gone, and then
    everything looks acknowledged.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
        message_type: What is published.
        qos: What the route says about QoS.
        room: Samples of the writer's history.
        log: Where to say which subscribers do not match, misread, or do not acknowledge.
        asks: Whether to ask the middleware what has arrived; else all has that was published.
        bounded: Whether the history refuses what is beyond its room.
    """

    def __init__(
        self,
        node: RosNode,
        topic: str,
        message_type: MessageType,
        qos: QoS,
        room: int,
        log: logging.LoggerAdapter[logging.Logger],
        *,
        asks: bool,
        bounded: bool,
    ) -> None:
        self._node = node
        self._topic = topic
        self._message_type = message_type
        self._qos = qos
        self._room = room
        self._log = log
        self._occasional = summed(log)
        self._where = f'publisher of {topic}'
        self._is_broken = self._is_failing = False
        self._matched = self._mismatched = 0
        self._told: set[tuple[str, str]] = set()  # of those in the graph
        self._misread = ''
        self.holders: list[str] = []
        self._graph_at_s = 0.0
        self._asks = asks
        self._bounded = bounded
        self._most = room if asks and not bounded else math.inf
        self._limit = room if asks or bounded else None
        self._publisher: Any = None
        self._publisher_qos: Any = None
        self._events: Any = None
        self._zero: Any = None
        self._published = 0
        self._acknowledged = 0
        self._confirmed = 0
        self._has_reader = self._is_acknowledged = self._is_confirmed = False
        self._gone = 0
        self._come_before = 0  # to publishers that this one has replaced
        self._come = 0
        self._come_known = 0  # by the last look at the graph
        self._look_at_s = 0.0

    def open(self) -> None:
        """Make the publisher.

        Raises:
            RouteError: ROS refuses it, for example for another type on the same topic.
        """
        from rclpy.duration import Duration  # noqa: PLC0415 (heavy)
        from rclpy.event_handler import PublisherEventCallbacks  # noqa: PLC0415

        from ros2_kafka_bridge.ros.take import MatchEvents  # noqa: PLC0415

        self._publisher_qos = profile(self._qos)
        kind = self._message_type.name
        with blamed(f'{self._where} as {kind}'), translated(self._where), self._node.endpoint_lock:
            self._publisher = self._node.handle.create_publisher(
                self._message_type.endpoint_class,
                self._topic,
                self._publisher_qos,
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
            self._events = MatchEvents(self._publisher)
        self._zero = Duration()

    @property
    def load(self) -> Load:
        """What its history holds, as far as its readers have told."""
        held = self._published - self._acknowledged
        return Load(held if self._limit is None else min(held, self._limit), self._limit)

    @property
    def matches(self) -> Matches:
        """Its subscribers at the last look."""
        return Matches(self._matched, self._mismatched)

    def publish(self, cdr: bytes) -> bool:
        """Publish; False: the history is full, nothing was taken, try the same bytes again.

        Raises:
            RouteError: ROS has failed. Another publisher takes the place of this one.
        """
        if self._published - self._acknowledged >= self._most:
            return False
        try:
            self._publisher.publish(cdr)
        except Exception as error:
            if 'cannot publish data' in str(error):  # a full history has no class of its own
                return False
            self._is_broken = True
            if known := translate(error, self._where):
                raise known from error
            raise
        self._published += 1
        return True

    def readers(self) -> Readers:
        """Look at the readers.

        Raises:
            RouteError: ROS has failed. Where it fails again, another publisher takes the place of
                this one.
        """
        if self._is_broken:
            self._open_anew()
        try:
            readers = self._look_at_readers()
        except Exception as error:  # not `translated`, which costs a microsecond
            self._is_broken, self._is_failing = self._is_failing, not self._is_failing
            if known := translate(error, self._where):
                raise known from error
            raise
        self._is_failing = False
        return readers

    def _look_at_readers(self) -> Readers:
        matched, come_here = self._events.look()
        come = self._come_before + come_here
        gone = come - matched
        now_s = time.monotonic()
        if now_s >= self._graph_at_s or (come, gone) != (self._come, self._gone):
            self._graph_at_s = now_s + _GRAPH_S
            self._look(come)
        self._come, self._matched = come, matched
        if gone != self._gone:
            self._gone = gone
            self._published = self._acknowledged = self._confirmed = 0
            return Readers(
                matched, come, lost=True, confirmed=0, acknowledged=False, misread=self._misread
            )
        if now_s >= self._look_at_s:
            self._look_at_s = now_s + _AGE_S
            self._confirmed, self._is_confirmed = self._acknowledged, self._is_acknowledged
            self._acknowledged = self._count_acknowledged()
            # What was published since the last look went to who was there by then.
            had_reader, self._has_reader = self._has_reader, bool(self.holders)
            self._is_acknowledged = self._asks and had_reader and self._has_reader
        return Readers(
            matched, come, lost=False, confirmed=self._confirmed,
            acknowledged=self._is_confirmed, misread=self._misread,
        )  # fmt: skip

    def close(self) -> None:
        """Destroy the publisher."""
        events, self._events = self._events, None
        if events is not None:
            with left_behind(self._log, self._where):
                events.close()
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            with left_behind(self._log, self._where), self._node.endpoint_lock:
                self._node.handle.destroy_publisher(publisher)

    def _open_anew(self) -> None:
        """Put another publisher in the place of one that has failed.

        Its readers have to come again: what the old one had published counts for nothing.
        """
        self.close()
        self._come_before = self._come
        self.open()
        self._is_broken = False

    def _count_acknowledged(self) -> int:
        """Tell how many messages are acknowledged."""
        if not self._asks or self._publisher.wait_for_all_acked(self._zero):
            return self._published
        if not self._bounded:
            return self._acknowledged
        return max(self._acknowledged, self._published - self._room)

    def _look(self, come: int) -> None:
        """Look at who they are, which is said, and tells who would misread."""
        try:
            self._look_at_graph()
        except BridgeError as error:
            # Of those who have come since the last look that could be, nothing is known.
            if come != self._come_known and self._message_type.type_hash:
                self._misread = f'perhaps a subscriber would misread: {error}'
            self.holders = []  # whether one of them acknowledges is not known, either
            self._occasional.warning(f'{error}')
        else:
            self._come_known = come

    def _look_at_graph(self) -> None:
        peers = self._node.subscribers(self._topic)
        here = {peer.node for peer in peers}
        self._told = {(node, what) for node, what in self._told if node in here}
        matching = [peer for peer in peers if not self._look_at_peer(peer)]
        self._mismatched = len(peers) - len(matching)
        who = ', '.join(sorted({peer.node for peer in matching if self._misreads(peer)}))
        kind = self._message_type.name
        self._misread = f'{who} would misread {kind}: {_SAME_VERSION}' if who else ''
        waited_for = [peer for peer in matching if peer.reliability != 'best_effort']
        self.holders = sorted({peer.node if peer.named else _NO_NODE for peer in waited_for})

    def _look_at_peer(self, peer: Peer) -> bool:
        """Tells whether it does not match."""
        if peer.message_type != self._message_type.name:
            self._tell(peer, f'subscribes to it as {peer.message_type}: no match')
            return True
        if reason := mismatch(self._publisher_qos, peer.qos):
            self._tell(peer, f'does not match, give this route the qos it asks for: {reason}')
            return True
        if self._misreads(peer):
            there, here = peer.type_hash, self._message_type.type_hash
            kind = f'{peer.message_type} {there}, this route publishes {here}'
            self._tell(peer, f'subscribes to it as {kind}: {_SAME_VERSION}')
        if peer.reliability == 'best_effort':
            self._tell(peer, 'reads best effort: nothing tells what it has received')
        return False

    def _misreads(self, peer: Peer) -> bool:
        return peer.misreads(self._message_type.name, self._message_type.type_hash)

    def _tell(self, peer: Peer, what: str) -> None:
        if peer.named and (peer.node, what) not in self._told:
            self._told.add((peer.node, what))
            self._occasional.warning(f'{self._topic}: {peer.node} {what}')
