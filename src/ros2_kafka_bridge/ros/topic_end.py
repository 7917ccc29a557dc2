"""Makes and destroys the endpoints that a route has at one topic of ROS."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any, NamedTuple

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import blamed
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.ros.errors import left_behind, translated
from ros2_kafka_bridge.ros.graph import View
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.types import MessageType


def _no_wait() -> None:
    pass


class OwnPublisher(NamedTuple):
    """A publisher of the bridge.

    Args:
        handle: That of rclpy.
        events: Counts its matches.
    """

    handle: Any
    events: Any

    def all_acknowledged(self) -> bool:
        """Whether all readers that acknowledge have all that was published."""
        from rclpy.duration import Duration  # noqa: PLC0415 (heavy)

        return bool(self.handle.wait_for_all_acked(Duration()))


class TopicEnd(NamedTuple):
    """What a route has at one topic of ROS.

    Args:
        node: The bridge's node.
        topic: The ROS topic.
        message_type: What is read or published.
        qos: What the route says about QoS.
        log: Where to say what happens.
        interrupt: Ends the wait of the route's thread: the graph has changed here.
    """

    node: RosNode
    topic: str
    message_type: MessageType
    qos: QoS
    log: Log
    interrupt: Callable[[], None] = _no_wait

    def watch_publishers(self) -> View:
        """Begin to follow who publishes; ends with `forget`."""
        ask = partial(self.node.publishers, self.topic)
        return self.node.graph.watch(ask, self.interrupt)

    def watch_subscribers(self) -> View:
        """Begin to follow who subscribes; ends with `forget`."""
        ask = partial(self.node.subscribers, self.topic)
        return self.node.graph.watch(ask, self.interrupt)

    def forget(self, view: View | None) -> None:
        """Follow them no more."""
        if view is not None:
            self.node.graph.forget(view)

    def subscribe(self, qos: Any) -> Any:
        """Make a subscription of that QoS, whose messages are taken as bytes.

        Raises:
            RouteError: ROS refuses it.
        """
        from rclpy.event_handler import SubscriptionEventCallbacks  # noqa: PLC0415 (heavy)

        where, kind = f'subscription of {self.topic}', self.message_type.name
        with blamed(f'{where} as {kind}'), translated(where), self.node.endpoint_lock:
            return self.node.handle.create_subscription(
                self.message_type.endpoint_class,
                self.topic,
                lambda _: None,
                qos,
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )

    def unsubscribe(self, subscription: Any) -> None:
        """Destroy a subscription, or leave it behind and say so."""
        with left_behind(self.log, f'subscription of {self.topic}'), self.node.endpoint_lock:
            self.node.handle.destroy_subscription(subscription)

    def advertise(self, qos: Any) -> OwnPublisher:
        """Make a publisher of that QoS.

        Raises:
            RouteError: ROS refuses it, for example for another type on the same topic.
        """
        from rclpy.event_handler import PublisherEventCallbacks  # noqa: PLC0415 (heavy)

        from ros2_kafka_bridge.ros.take import MatchEvents  # noqa: PLC0415

        where, kind, handle = f'publisher of {self.topic}', self.message_type, self.node.handle
        made = blamed(f'{where} as {kind.name}')
        with made, translated(where), self.node.endpoint_lock, ExitStack() as undo:
            publisher = handle.create_publisher(
                kind.endpoint_class,
                self.topic,
                qos,
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
            undo.callback(handle.destroy_publisher, publisher)
            events = MatchEvents(publisher)
            undo.pop_all()
            return OwnPublisher(publisher, events)

    def withdraw(self, publisher: OwnPublisher) -> None:
        """Destroy a publisher, or leave it behind and say so."""
        where = f'publisher of {self.topic}'
        with left_behind(self.log, where):
            publisher.events.close()
        with left_behind(self.log, where), self.node.endpoint_lock:
            self.node.handle.destroy_publisher(publisher.handle)
