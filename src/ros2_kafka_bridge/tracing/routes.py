"""What the routes of a bridge are traced with, resolved before anything moves."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.route.labels import MakeHeaders
from ros2_kafka_bridge.tracing.messages import (
    NO_MESSAGE_TRACES,
    MessageTraces,
    SpansOfMessages,
    with_traceparent,
)
from ros2_kafka_bridge.tracing.records import NO_RECORD_TRACES, RecordTraces, SpansOfRecords
from ros2_kafka_bridge.tracing.span import Attributes, EndSpan

_SYSTEM: Final = {'messaging.system': 'kafka'}


class Tracing(NamedTuple):
    """Makes what traces a route.

    Args:
        sample: Share of the traces that begin here and are sampled; None writes no header.
        end: Takes the spans; None makes none.
        kafka: librdkafka properties of the bridge.
        bridge: Name of the bridge.
    """

    sample: float | None = None
    end: EndSpan | None = None
    kafka: dict[str, Any] = {}  # noqa: RUF012 (never changed)
    bridge: str = ''

    def headers(self, make_headers: MakeHeaders) -> MakeHeaders:
        """What makes the headers of a message, with a `traceparent` where there is tracing."""
        if self.sample is None:
            return make_headers
        return with_traceparent(make_headers, self.sample)

    def records(self, route: KafkaToRosRoute) -> RecordTraces:
        """What follows the records of a route."""
        if self.sample is None or self.end is None:
            return NO_RECORD_TRACES
        topic = route.kafka_topic
        same: Attributes = {
            **self._same(route.name, topic, route.ros_topic, route.type_name),
            'messaging.operation.name': 'process',
            'messaging.operation.type': 'process',
            'messaging.consumer.group.name': route.group(self.bridge),
        }
        return SpansOfRecords(topic, same, self.sample, self.end)

    def messages(self, route: RosToKafkaRoute, message_type: str) -> MessageTraces:
        """What follows the messages of a route."""
        if self.sample is None or self.end is None:
            return NO_MESSAGE_TRACES
        topic = route.kafka_topic
        same: Attributes = {
            **self._same(route.name, topic, route.ros_topic, message_type),
            'messaging.operation.name': 'publish',
            'messaging.operation.type': 'send',
        }
        return SpansOfMessages(topic, same, self.end)

    def _same(self, route: str, topic: str, ros_topic: str, message_type: str) -> Attributes:
        client = self.kafka.get('client.id', self.bridge)
        return {
            **_SYSTEM,
            'messaging.destination.name': topic,
            'messaging.client.id': str(client),
            'ros.topic': ros_topic,
            'ros.type': message_type,
            'ros2_kafka_bridge.route': route,
        }


@contextmanager
def open_tracing(config: Config, worker: int, log: RouteLog) -> Iterator[Tracing]:
    """Trace while the block runs, as the configuration says; at its end, send what waits.

    Args:
        config: Of the bridge.
        worker: Number of this process; 0 where it is the only one.
        log: Where to say that spans are not taken.
    """
    settings = config.tracing
    if settings is None:
        yield Tracing()
        return
    headers_only = Tracing(settings.sample, None, config.kafka, config.name)
    if not settings.exports(os.environ):
        yield headers_only
        return
    from ros2_kafka_bridge.tracing.export import Service, open_exporter  # noqa: PLC0415 (an extra)

    service = Service(settings.service or config.name, config.name, worker)
    with open_exporter(service, settings.endpoint, log) as exporter:
        yield headers_only._replace(end=exporter.end)
