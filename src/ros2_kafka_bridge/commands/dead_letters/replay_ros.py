"""Publishing dead letters straight to ROS, until their readers have them."""

import time
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Final, Self

from ros2_kafka_bridge.commands.screen import waiting
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.endpoints import MessageSink, Readers
from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, open_node
from ros2_kafka_bridge.ros.publisher import RosSink
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.route.pace import Pace
from ros2_kafka_bridge.route.settling import Settling
from ros2_kafka_bridge.threads.stop import Stop

_PATIENCE_S: Final = 30.0
_NAP_S: Final = 0.005


class RosDelivery:
    """The ROS topics of the routes, each opened when the first message for it comes.

    Args:
        config: With the routes.
        stop: Ends the waiting.
    """

    def __init__(self, config: Config, stop: Stop) -> None:
        self._config = config
        self._stop = stop
        self._stack = ExitStack()
        self._node: RosNode | None = None
        self._channels: dict[str, Channel] = {}

    def __enter__(self) -> Self:
        routes = [route for route in self._config.routes if isinstance(route, KafkaToRosRoute)]
        writers = {route.sink.ros: route.max_in_flight for route in routes}
        histories = Histories(writers, {}, self._config.ros.lease_s)
        name = f'{self._config.name}_replay'
        self._node = self._stack.enter_context(
            open_node(name, self._config.ros.domain_id, histories)
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def deliver(self, route: KafkaToRosRoute, messages: Sequence[bytes]) -> None:
        """Publish messages in order, and wait until every reader has acknowledged all of them.

        Raises:
            TransportError: There are too few readers, or one does not acknowledge.
            RouteError: ROS refuses the publisher.
        """
        if route.name not in self._channels:
            self._channels[route.name] = Channel(route, self._open(route), self._stop)
        self._channels[route.name].deliver(messages)

    def _open(self, route: KafkaToRosRoute) -> RosSink:
        assert self._node is not None, 'the delivery is open'
        # Whatever the route offers: an acknowledgement is waited for here.
        firm = {'reliability': 'reliable', 'history': 'keep_all', 'depth': None}
        qos = route.sink.qos.model_copy(update=firm)
        sink = RosSink(
            self._node,
            route.sink.ros,
            load_type(route.sink.type),
            qos,
            None,
            route_log(route.name),
        )
        self._stack.callback(sink.close)
        sink.open()
        return sink


class Channel:
    """One ROS topic, and what it has acknowledged.

    Args:
        route: How many readers are waited for, and how fast they take.
        sink: Open already.
        stop: Ends the waiting.
    """

    def __init__(self, route: KafkaToRosRoute, sink: MessageSink, stop: Stop) -> None:
        self._topic = route.sink.ros
        self._needed = max(1, route.min_subscribers)
        self._sink = sink
        self._stop = stop
        self._pace = Pace(route.max_rate)
        self._before = 0  # published and confirmed since a reader was lost last
        self._settling = Settling(self._needed)

    def deliver(self, messages: Sequence[bytes]) -> None:
        """Publish messages in order, and wait until every reader has acknowledged all of them.

        Raises:
            TransportError: There are too few readers, or one does not acknowledge.
        """
        pending = deque(messages)
        confirmed, deadline_s = -1, time.monotonic() + _PATIENCE_S
        with waiting(f'Waiting for the subscribers of {self._topic}'):
            while True:
                readers = self._sink.readers()
                self._settling.look(readers)
                if readers.lost:
                    self._before = 0
                    pending = deque(messages)
                elif not pending and readers.confirmed >= self._before + len(messages):
                    self._before += len(messages)
                    return
                moved = self._settling.obstacle is None and self._publish(pending)
                if moved or readers.confirmed != confirmed:
                    confirmed, deadline_s = readers.confirmed, time.monotonic() + _PATIENCE_S
                self._check(readers, deadline_s, begun=len(pending) < len(messages))
                time.sleep(_NAP_S)

    def _publish(self, pending: deque[bytes]) -> bool:
        """Publish what there is room for; tells whether there was any."""
        before = len(pending)
        while pending and self._pace.go() and self._sink.publish(pending[0]):
            pending.popleft()
        return len(pending) < before

    def _check(self, readers: Readers, deadline_s: float, *, begun: bool) -> None:
        # What is published gets its marks, or it would be published again by the next replay.
        if self._stop.at_once or (self._stop.asked and not begun):
            raise TransportError(f'stopped while waiting for the subscribers of {self._topic}')
        if time.monotonic() < deadline_s:
            return
        if readers.matched < self._needed:
            there = f'{readers.matched} of {count(self._needed, "subscriber")}'
            raise TransportError(f'{there} of {self._topic} there after {_PATIENCE_S:g} s')
        raise TransportError(f'a subscriber of {self._topic} does not take: not acknowledged')
