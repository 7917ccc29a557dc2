"""The clients that a bridge with so many routes cannot do without, and nothing else.

python -m benchmarks.bare_clients localhost:9092 KAFKA_STEM ROS_STEM 25

One node; for each number a publisher and a consumer that a thread polls every 0.1 s, as the
bridge does, and a subscription and an idempotent producer. Nothing is moved.
"""

import argparse
import os
import signal
import threading
import time
from typing import NoReturn

import rclpy
from confluent_kafka import Consumer, Producer
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from rig.peers.ends import qos

POLL_S = 0.1


def main() -> None:
    """Be there until told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('brokers')
    parser.add_argument('kafka', help='STEM.to_ros.0 and so on are read')
    parser.add_argument('ros', help='STEM/to_ros0 is published on, STEM/to_kafka0 is read')
    parser.add_argument('count', type=int)
    args = parser.parse_args()
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])  # also in the clients' threads
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('bare')
    common = {'bootstrap.servers': args.brokers, 'log_level': 3}
    keep_all = qos()
    ends: list[object] = []
    came: list[object] = []
    for number in range(args.count):
        ends.append(node.create_publisher(String, f'{args.ros}/to_ros{number}', keep_all))
        back = f'{args.ros}/to_kafka{number}'
        ends.append(node.create_subscription(String, back, lambda _: None, keep_all, raw=True))
        ends.append(Producer({**common, 'enable.idempotence': True}))
        topic = f'{args.kafka}.to_ros.{number}'
        consumer = Consumer({**common, 'group.id': f'bare.{topic}'})
        consumer.subscribe([topic], on_assign=lambda *it: came.append(it))
        threading.Thread(target=_poll, args=(consumer,), daemon=True).start()
    while len(came) < args.count:
        time.sleep(POLL_S)
    print('ready', flush=True)
    signal.sigwait([signal.SIGTERM])
    rclpy.shutdown()  # takes its files in /dev/shm along
    os._exit(0)


def _poll(consumer: Consumer) -> NoReturn:
    while True:
        consumer.poll(POLL_S)


if __name__ == '__main__':
    main()
