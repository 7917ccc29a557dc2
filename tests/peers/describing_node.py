"""A robot's node that publishes and takes CDR bytes of a type, and describes it, or not.

It prints `ready` when it spins, and `asked` when it will not answer.
"""

import argparse
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from type_description_interfaces.msg import Field, FieldType, IndividualTypeDescription
from type_description_interfaces.srv import GetTypeDescription

from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class

QOS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def lie(request: Any, response: Any) -> Any:
    """Describe every type by one field that it has not."""
    told = IndividualTypeDescription(type_name=request.type_name)
    told.fields = [Field(name='lie', type=FieldType(type_id=2))]
    response.successful = True
    response.type_description.type_description = told
    return response


def keep_silent(_request: Any, _response: Any) -> Any:
    """Never answer."""
    print('asked', flush=True)  # noqa: T201
    while True:
        time.sleep(1)


SERVICES = {'lies': lie, 'never': keep_silent}


def main() -> None:
    """Publish the lines of files of hex, take what is published, and spin."""
    parser = argparse.ArgumentParser()
    parser.add_argument('message_type')
    parser.add_argument('--prefix', default='', help='where its packages are installed')
    parser.add_argument('--publish', action='append', default=[], metavar='TOPIC=FILE')
    parser.add_argument('--take', action='append', default=[], metavar='TOPIC=FILE')
    parser.add_argument('--describes', choices=['rightly', 'not', *SERVICES], default='rightly')
    parser.add_argument('--name', default=f'robot_{os.getpid()}')
    args = parser.parse_args()
    os.environ['AMENT_PREFIX_PATH'] = args.prefix
    rclpy.init()
    service = Parameter('start_type_description_service', value=args.describes == 'rightly')
    node = Node(args.name, parameter_overrides=[service])
    if serve := SERVICES.get(args.describes):
        node.create_service(GetTypeDescription, '~/get_type_description', serve)
    made = endpoint_class(args.message_type, describe(args.message_type).types)
    for topic, _, file in (one.partition('=') for one in args.publish):
        publisher = node.create_publisher(made, topic, QOS)
        for line in Path(file).read_text().split():
            publisher.publish(bytes.fromhex(line))
    for topic, _, file in (one.partition('=') for one in args.take):
        node.create_subscription(made, topic, writer_of(Path(file)), QOS, raw=True)
    print('ready', flush=True)  # noqa: T201
    rclpy.spin(node)


def writer_of(path: Path) -> Any:
    """Make what appends each message to a file, in hex."""

    def write(cdr: bytes) -> None:
        with path.open('a') as file:
            file.write(f'{cdr.hex()}\n')

    return write


with suppress(KeyboardInterrupt):
    main()
