"""The limit without Python: loops in C that move bytes, and nothing else.

    python native.py LOOPS kafka_to_ros|ros_to_kafka BROKER KAFKA_TOPIC ROS_TOPIC

No key, no header, no confirmation, nothing that counts. The DDS settings are the bridge's own, and
librdkafka is the one of confluent-kafka. LOOPS is what a C compiler has made of `native.c`.
"""

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import confluent_kafka
from std_msgs.msg import String

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.qos import profile

# As of the contestant `bare`.
_HISTORY: Final = 500
_CACHE: Final = 2000
_SETTLE_S: Final = 1.0


class Loop(NamedTuple):
    """One of the loops.

    Args:
        library: With all of them.
        name: Of the function.
        kafka_topic: Its end in Kafka.
    """

    library: str
    name: str
    kafka_topic: str

    def run(self, end: Any, properties: Mapping[str, str]) -> None:
        """Run it in a thread until SIGTERM: signals come to the first one.

        Args:
            end: That in ROS, as rclpy has it.
            properties: For its Kafka client.
        """
        told, ends = threading.Event(), ctypes.c_int(0)
        signal.signal(signal.SIGTERM, lambda *_: told.set())
        words = [word.encode() for pair in properties.items() for word in pair]
        pairs = (ctypes.c_char_p * (len(words) + 1))(*words, None)
        place, topic = ctypes.c_void_p(end.handle.pointer), self.kafka_topic.encode()
        function = getattr(_loaded(self.library), self.name)
        loop = threading.Thread(target=function, args=(place, topic, pairs, ctypes.byref(ends)))
        loop.start()
        told.wait()
        ends.value = 1
        loop.join()


def main(loops: str, name: str, bootstrap_servers: str, kafka_topic: str, ros_topic: str) -> None:
    """Move messages until told to end."""
    move = {'kafka_to_ros': kafka_to_ros, 'ros_to_kafka': ros_to_kafka}[name]
    move(Loop(loops, name, kafka_topic), {'bootstrap.servers': bootstrap_servers}, ros_topic)


def kafka_to_ros(loop: Loop, broker: dict[str, str], ros_topic: str) -> None:
    """Publish each record; while the history is full, sleep and try again."""
    own = {
        'group.id': f'{loop.kafka_topic}.native',
        'auto.offset.reset': 'earliest',
        'enable.auto.commit': 'false',
    }
    with open_node('native_kafka_ros', None, Histories({ros_topic: _HISTORY}, {})) as node:
        publisher = node.handle.create_publisher(String, ros_topic, profile(QoS()))
        while not publisher.get_subscription_count():
            time.sleep(0.01)
        time.sleep(_SETTLE_S)  # the writer knows of the match before the reader does
        loop.run(publisher, broker | own)


def ros_to_kafka(loop: Loop, broker: dict[str, str], ros_topic: str) -> None:
    """Produce each message; while the producer's queue is full, wait for room."""
    with open_node('native_ros_kafka', None, Histories({}, {ros_topic: _CACHE})) as node:
        subscription = node.handle.create_subscription(
            String, ros_topic, lambda _: None, profile(QoS()), raw=True
        )
        print('subscribed', flush=True)
        own = {'acks': 'all', 'enable.idempotence': 'true'}
        loop.run(subscription, broker | own)


def _loaded(loops: str) -> ctypes.CDLL:
    """Load the loops, and before them what they call."""
    wheel = Path(confluent_kafka.__file__).parents[1] / 'confluent_kafka.libs'
    for library in ('librcl.so', 'librcutils.so', *map(str, wheel.glob('librdkafka-*'))):
        ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL)
    return ctypes.CDLL(loops)


if __name__ == '__main__':
    main(*sys.argv[1:])
