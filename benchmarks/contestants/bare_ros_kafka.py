"""The limit, ROS -> Kafka: take and produce bytes, and nothing else.

The same key, the same seven headers, acks=all and an idempotent producer; but no delivery
report, no window, one number that counts, no watch on gaps or on the graph. The DDS settings are
the bridge's own.
"""

import signal
import struct
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from confluent_kafka import Producer
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String

from benchmarks.contestants.node import Count, NodeArguments, arguments
from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import load_type

BATCH = 500
CACHE = 2000
WAIT_NS = 100_000_000


def main() -> None:
    """Move messages until told to end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    given = arguments(__doc__)
    count = Count('ros_to_kafka', given.snapshots)
    with open_node('bare_ros_kafka', None, Histories({}, {given.ros_topic: CACHE})) as node:
        subscription = node.handle.create_subscription(
            String, given.ros_topic, lambda _: None, profile(QoS()), raw=True
        )
        count.start()
        print('subscribed', flush=True)
        producer = Producer(
            {
                'bootstrap.servers': given.bootstrap_servers,
                'acks': 'all',
                'enable.idempotence': True,
                **given.properties,
            }
        )
        try:
            move(taken(node.context, subscription), producer, given, count)
        finally:
            count.tell()


def taken(context: Any, subscription: Any) -> Iterator[list[tuple[bytes, Mapping[str, Any]]]]:
    """Wait for messages and take them, batch after batch."""
    handle = subscription.handle
    waiter = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, context.handle)
    while True:
        batch: list[tuple[bytes, Mapping[str, Any]]] = []
        with handle:
            take = handle.take_message
            while len(batch) < BATCH and (one := take(String, True)) is not None:  # noqa: FBT003
                batch.append(one)
        if batch:
            yield batch
        else:
            waiter.clear_entities()
            waiter.add_subscription(handle)
            waiter.wait(WAIT_NS)


def move(batches: Iterator[Any], producer: Producer, given: NodeArguments, count: Count) -> None:
    """Produce each message; while the producer's queue is full, wait for room."""
    produce, poll = producer.produce, producer.poll
    kafka_topic, ros_topic = given.kafka_topic, given.ros_topic
    key = ros_topic.encode()
    length = struct.Struct('<I').unpack_from
    same: list[tuple[str, str | bytes | None]] = []
    for batch in batches:
        for cdr, info in batch:
            same = same or headers(ros_topic, info['publisher_gid']['data'])
            seq, at_ns = info['publication_sequence_number'], info['source_timestamp']
            told = [*same, ('ros.seq', b'%d' % seq), ('ros.source_time_ns', b'%d' % at_ns)]
            value = cdr[8 : 7 + length(cdr, 4)[0]]
            while True:
                try:
                    produce(kafka_topic, value, key, headers=told)
                except BufferError:
                    poll(0.01)
                else:
                    break
        poll(0)
        count.confirmed += len(batch)


def headers(ros_topic: str, gid: bytes) -> list[tuple[str, str | bytes | None]]:
    """Make the headers that are the same in every record of a publisher."""
    message_type = load_type('std_msgs/msg/String')
    told = {
        'ros.topic': ros_topic,
        'ros.type': message_type.name,
        'ros.type_hash': message_type.type_hash or '',
        'ros.gid': gid.hex(),
        'bridge.origin': 'drain',
        'bridge.route': 'drain',
    }
    return [(name, value.encode()) for name, value in told.items()]


main()
