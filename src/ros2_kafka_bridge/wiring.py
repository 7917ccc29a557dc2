"""How a route is made of its settings: which ends, which format, which labels."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.endpoints import RecordSource
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.formats import Encode
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.names import tail_group
from ros2_kafka_bridge.kafka.producer import KafkaSink
from ros2_kafka_bridge.kafka.properties import (
    common_properties,
    consumer_properties,
    prefetch_bytes,
    producer_properties,
)
from ros2_kafka_bridge.kafka.tail import KafkaTail
from ros2_kafka_bridge.kafka.topic_id import TopicIds
from ros2_kafka_bridge.kafka.topics import ensure_topic
from ros2_kafka_bridge.kafka_to_ros import KafkaToRos
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.size import largest_message_bytes
from ros2_kafka_bridge.ros.arrivals import Arrivals, enough_files
from ros2_kafka_bridge.ros.confirmation import Confirmation, asks_readers
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.message_sizes import Sizes
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.probe import Abilities
from ros2_kafka_bridge.ros.sink import RosSink
from ros2_kafka_bridge.ros.source import OnTake, RosSource
from ros2_kafka_bridge.ros.successor import SuccessorWatch
from ros2_kafka_bridge.ros.topic_end import TopicEnd
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.topic_writer import TopicWriter
from ros2_kafka_bridge.ros.types import MessageType
from ros2_kafka_bridge.ros.used_type import RosEnd, RouteTypes
from ros2_kafka_bridge.ros.writer_history import WriterHistory
from ros2_kafka_bridge.ros_to_kafka import RosToKafka
from ros2_kafka_bridge.route.dead_letters import DeadLetters
from ros2_kafka_bridge.route.flight.messages import MessageEntry
from ros2_kafka_bridge.route.format import asks_registry, decode_of, encode_of
from ros2_kafka_bridge.route.identity import Author, make_identify
from ros2_kafka_bridge.route.labels import Conversion, make_headers, make_key
from ros2_kafka_bridge.route.memory import (
    FRAME_BYTES,
    Kept,
    note_memory,
    queue_bytes,
    take_bytes,
)
from ros2_kafka_bridge.route.produced import Produced
from ros2_kafka_bridge.route.rejections import message_of_letter
from ros2_kafka_bridge.route.type_hash import check_message_of, check_record_of
from ros2_kafka_bridge.spool.backlog import Backlog
from ros2_kafka_bridge.spool.backlog_source import OF_NOTHING, Silence
from ros2_kafka_bridge.spool.lock import is_in_use, lock_of
from ros2_kafka_bridge.spool.store import Spool, file_of
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.tracing.routes import Tracing

_LARGEST_BATCH_BYTES = 1_000_000
_LEAST_KBYTES = 1024
_LARGEST_LETTER_BYTES = 1_000_000_000  # the most that librdkafka takes

Pipeline = KafkaToRos | RosToKafka
Say = Callable[[str], None]


class Wiring:
    """What all routes share, and how a route is made of it."""

    def __init__(
        self,
        config: Config,
        node: RosNode,
        abilities: Abilities,
        histories: Histories,
        sizes: Sizes,
        tracing: Tracing,
    ) -> None:
        self._config = config
        self._node = node
        self._abilities = abilities
        self._confirmation = Confirmation(node, abilities)
        self._histories = histories
        self._sizes = sizes
        self._tracing = tracing
        self._types = RouteTypes(node, config.ros)
        self._topic_ids = TopicIds(common_properties(config.kafka, client_id=config.name))

    def make(
        self,
        route: AnyRoute,
        log: Log,
        stop: Stop,
        stack: ExitStack,
        say: Say = lambda _: None,
        on_take: OnTake = lambda _: None,
    ) -> Pipeline | None:
        """Make what runs a route; None where a stop came while its type was waited for.

        Its ROS endpoint is open until the stack closes: a route that fails on the Kafka side
        keeps it, so that DDS holds the publishers back meanwhile. `say` is told what is waited
        for, where that takes long, and `on_take` what each take from ROS has brought.

        Raises:
            RouteError: The route cannot run now; its ROS endpoint is closed.
        """
        with ExitStack() as made:
            if isinstance(route, KafkaToRosRoute):
                pipeline: Pipeline | None = self._kafka_to_ros(route, log, stop, made, say)
            else:
                pipeline = self._ros_to_kafka(route, log, stop, made, say, on_take)
            stack.push(made.pop_all())
        return pipeline

    def successor(self, route: AnyRoute) -> SuccessorWatch:
        """Make what knows whether another bridge of this name reads the ROS topic of a route."""
        topic, own = route.ros_topic, self._abilities.own
        return SuccessorWatch(self._node, topic, self._config.name, own)

    def claim_spool(self, pipeline: Pipeline) -> None:
        """Keep the spool of a route, if it has one, until its stack closes.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: It cannot be kept.
        """
        if pipeline.spool is not None:
            pipeline.spool.claim()

    def is_spool_in_use(self, route: AnyRoute) -> bool:
        """Whether a process has the spool of a route; not asked while this one has."""
        return route.spool is not None and is_in_use(lock_of(self._spool_of(route)))

    def make_for_backlog(self, route: AnyRoute, log: Log) -> RosToKafka | None:
        """Make what delivers the spool of a route that another bridge runs; None without one.

        It takes nothing from ROS, where the other one reads.
        """
        if route.spool is None or not self._spool_of(route).exists():
            return None
        return RosToKafka(
            route,
            Silence(),
            self._produced(route, log),
            self._kafka_sink(route, log),
            OF_NOTHING,
            self._dead_letters(route, log),
            self._backlog(route, log),
            log,
            self._tracing.messages(route, route.type_name or ''),
        )

    def _kafka_to_ros(
        self, route: KafkaToRosRoute, log: Log, stop: Stop, stack: ExitStack, say: Say
    ) -> KafkaToRos | None:
        source = KafkaSource(
            self._consumer_properties(route.group(self._config.name)),
            route.kafka_topic,
            route.source.start,
            self._topic_ids,
            log,
            self._config.membership,
            stop.wakeup,
        )
        pipeline = self.to_ros(route, source, log, stop, stack, say)
        if pipeline is not None and route.max_rate is None:
            log.info(
                'a subscriber of %s that is KEEP_LAST can overwrite its own queue unseen: '
                'max_rate is the cure',
                route.ros_topic,
            )
        return pipeline

    def to_ros(
        self,
        route: KafkaToRosRoute,
        source: RecordSource,
        log: Log,
        stop: Stop,
        stack: ExitStack,
        say: Say = lambda _: None,
    ) -> KafkaToRos | None:
        """Make what carries the records of any source to the ROS topic of a route.

        Its ROS endpoint is open until the stack closes. None where a stop came first.

        Raises:
            RouteError: The route cannot run now.
        """
        message_type = self._types.load(RosEnd.of(route), log, stop, say)
        if message_type is None:
            return None
        asks = asks_readers(route, self._config)
        if asks and not self._confirmation.require(stop):
            return None
        topic = route.ros_topic
        end = TopicEnd(self._node, topic, message_type, route.qos, log, stop.wakeup.ring)
        room, bounded = self._histories.writers[topic], self._abilities.bounded
        sink = RosSink({topic: TopicWriter(end, WriterHistory(room, asks=asks, bounded=bounded))})
        decode = decode_of(route, self._config, message_type.layout)
        stack.enter_context(_open(sink))
        pipeline = KafkaToRos(
            route,
            self._config.name,
            source,
            sink,
            check_record_of(route, message_type.layout),
            decode,
            self._dead_letters(route, log),
            log,
            self._tracing.records(route),
        )
        self._note_memory(pipeline, route, room, message_type.layout, log)
        return pipeline

    def _ros_to_kafka(
        self,
        route: RosToKafkaRoute,
        log: Log,
        stop: Stop,
        stack: ExitStack,
        say: Say,
        on_take: OnTake,
    ) -> RosToKafka | None:
        message_type = self._types.load(RosEnd.of(route), log, stop, say)
        if message_type is None:
            return None
        try:
            return self._of_type(message_type, route, log, stop, stack, on_take)
        except ConfigError as error:
            if route.type_name is not None:
                raise
            # What others publish may be mended there, and is no mistake of the configuration.
            raise RouteError(str(error)) from error

    def _of_type(
        self,
        kind: MessageType,
        route: RosToKafkaRoute,
        log: Log,
        stop: Stop,
        stack: ExitStack,
        on_take: OnTake,
    ) -> RosToKafka:
        produced = self._produced(route, log)
        topic, has_gid = route.ros_topic, self._abilities.gid and self._abilities.seq
        end = TopicEnd(self._node, topic, kind, route.qos, log, stop.wakeup.ring)
        with enough_files():
            arrivals = Arrivals(stop.wakeup)
            reader = TopicReader(
                end, arrivals, has_gid=has_gid, by_rcl=self._abilities.by_rcl,
                take_bytes=take_bytes(route), on_offer=produced.look,
            )  # fmt: skip
        source = RosSource(arrivals, {topic: reader}, on_take)
        asks = asks_registry(route)
        encode = None if asks else encode_of(route, self._config, kind.layout)

        def make_encode() -> Encode:
            try:
                return encode or encode_of(route, self._config, kind.layout)
            except ConfigError as error:
                if route.type_name is not None:
                    raise
                raise RouteError(str(error)) from error  # as where the type is learned

        conversion = Conversion(
            make_encode,
            make_key(route.key, topic, kind.layout),
            self._tracing.headers(make_headers(self._author(route), kind.name, reader.type_hash)),
            check_message_of(route, kind.layout),
        )
        # From here on DDS holds the publishers back: nothing behind this line may ask Kafka, or
        # an outage would close the reader again.
        stack.enter_context(_open(source))
        pipeline = RosToKafka(
            route,
            source,
            produced,
            self._kafka_sink(route, log),
            conversion,
            self._dead_letters(route, log),
            self._backlog(route, log),
            log,
            self._tracing.messages(route, kind.name),
        )
        self._note_memory(pipeline, route, self._histories.readers[topic], kind.layout, log)
        if pipeline.spool is not None:
            stack.callback(pipeline.spool.release)
        return pipeline

    def _note_memory(
        self, pipeline: Pipeline, route: AnyRoute, samples: int, layout: Layout, log: Log
    ) -> None:
        if not self._abilities.bounded:
            return  # nobody knows how much is kept
        kept = Kept(samples, largest_message_bytes(layout, route.max_message_bytes))
        prefetched, known = prefetch_bytes(self._config.kafka), route.name in self._sizes
        note_memory(pipeline.counters, route, kept, prefetched, log, known=known)

    def _produced(self, route: RosToKafkaRoute, log: Log) -> Produced:
        properties = self._consumer_properties(tail_group(self._config.name, route.name))
        identify = make_identify(self._author(route))
        return Produced(
            KafkaTail(properties, route.kafka_topic),
            KafkaTail(properties, route.dead_letter_topic),
            identify,
            partial(message_of_letter, route, identify),
            log,
        )

    def _author(self, route: RosToKafkaRoute) -> Author:
        return Author(route.ros_topic, self._config.name, route.name)

    def _kafka_sink(self, route: RosToKafkaRoute, log: Log) -> KafkaSink[MessageEntry]:
        properties = self._producer_properties(route)
        return KafkaSink(properties, route.kafka_topic, log, fits_topic=True)

    def _spool_of(self, route: RosToKafkaRoute) -> Path:
        assert route.spool is not None
        return file_of(Path(route.spool.path), self._config.name, route.name)

    def _backlog(self, route: RosToKafkaRoute, log: Log) -> Backlog | None:
        if route.spool is None:
            return None
        spool = Spool(self._spool_of(route), sync=route.spool.sync == 'batch', log=log)
        return Backlog(
            spool,
            route.spool,
            log,
            drops=route.drops,
            largest_bytes=route.max_message_bytes,
        )

    def _consumer_properties(self, group: str) -> dict[str, Any]:
        name = self._config.name
        return consumer_properties(self._config.kafka, group=group, client_id=name)

    def _producer_properties(self, route: RosToKafkaRoute) -> dict[str, Any]:
        users = {**self._config.kafka, **route.sink.properties}
        own = {
            'queue.buffering.max.messages': route.max_in_flight,
            'queue.buffering.max.kbytes': _kbytes(route),
            'message.max.bytes': max(_LARGEST_BATCH_BYTES, route.max_message_bytes + FRAME_BYTES),
        }
        return own | producer_properties(users, client_id=self._config.name)

    def _dead_letters(self, route: AnyRoute, log: Log) -> DeadLetters[Any]:
        topic = route.dead_letter_topic
        properties = producer_properties(self._config.kafka, client_id=self._config.name)
        # Each on its own, and refused by the broker alone: none is refused for the others' sizes.
        properties |= {
            'batch.num.messages': 1,
            'message.max.bytes': _LARGEST_LETTER_BYTES,
            'queue.buffering.max.kbytes': _kbytes(route),
        }
        return DeadLetters(
            topic,
            KafkaSink(properties, topic, log),
            lambda: ensure_topic(properties, topic),
            log,
        )


def _kbytes(route: AnyRoute) -> int:
    """Room of a producer's queue."""
    return max(_LEAST_KBYTES, queue_bytes(route) // 1024 + 1)


@contextmanager
def _open(end: RosSink | RosSource) -> Iterator[None]:
    try:
        end.open()
        yield
    finally:
        end.close()
