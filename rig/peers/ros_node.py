"""A node of ROS with many topics of any types; it can describe its types to others, or not.

What it publishes is in a file, `topic type hex` a line, without the hex for a publisher alone;
what it takes in another, `topic type file` a line, where each message is appended in hex. With
the packages of its types it publishes message objects, else bytes. `--typed` takes objects, too,
and both are told as Python prints them: what is published beside its file, in one that ends in
`.sent`. It prints `ready` when all is published and it spins, and `asked` when it will not answer.
"""

import argparse
import os
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from type_description_interfaces.msg import Field, FieldType, IndividualTypeDescription
from type_description_interfaces.srv import GetTypeDescription

from rig.peers.ends import kind_of, qos, wait_for_readers


def lie(request: Any, response: Any) -> Any:
    """Describe every type by one field that it has not."""
    told = IndividualTypeDescription(type_name=request.type_name)
    told.fields = [Field(name='lie', type=FieldType(type_id=2))]
    response.successful = True
    response.type_description.type_description = told
    return response


def keep_silent(_request: Any, _response: Any) -> Any:
    """Never answer."""
    print('asked', flush=True)
    while True:
        time.sleep(1)


SERVICES = {'lies': lie, 'never': keep_silent}


def main() -> None:
    """Publish and take until told to end."""
    args = _parse()
    if args.made:
        os.environ['AMENT_PREFIX_PATH'] = args.made
    rclpy.init()
    service = Parameter('start_type_description_service', value=args.describes == 'rightly')
    node = Node(args.name, parameter_overrides=[service])
    if serve := SERVICES.get(args.describes):
        node.create_service(GetTypeDescription, '~/get_type_description', serve)
    kind_in = cache(_made if args.made else kind_of)
    profile = qos(args.durability)
    for topic, message_type, file in _rows(args.take):
        write = _writer(Path(file), is_typed=args.typed)
        kind = kind_in(message_type)
        node.create_subscription(kind, topic, write, profile, raw=not args.typed)
    publishers: dict[str, Any] = {}
    messages: list[tuple[Any, Any]] = []
    for topic, message_type, *sent in _rows(args.publish):
        kind = kind_in(message_type)
        if topic not in publishers:
            publishers[topic] = node.create_publisher(kind, topic, profile)
        cdrs = map(bytes.fromhex, sent)
        made = cdrs if args.made else (deserialize_message(cdr, kind) for cdr in cdrs)
        messages += [(publishers[topic], message) for message in made]
    wait_for_readers(publishers.values(), args.readers)
    if args.typed and args.publish:
        args.publish.with_suffix('.sent').write_text(''.join(f'{it!r}\n' for _, it in messages))
    for publisher, message in messages:
        publisher.publish(message)
    while any(node.count_publishers(row[0]) < args.writers for row in _rows(args.take)):
        time.sleep(0.1)
    print('ready', flush=True)
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        rclpy.spin(node)


def _made(message_type: str) -> Any:
    """What stands for the class of a type where its packages are not imported."""
    from ros2_kafka_bridge.message_types import describe  # noqa: PLC0415 (not for any user's)
    from ros2_kafka_bridge.ros.type_support.handle import endpoint_class  # noqa: PLC0415

    return endpoint_class(message_type, describe(message_type).types)


def _rows(file: Path | None) -> list[list[str]]:
    return [line.split() for line in file.read_text().splitlines()] if file else []


def _writer(path: Path, *, is_typed: bool) -> Any:
    """Make what appends each message to a file."""

    def write(message: Any) -> None:
        with path.open('a') as file:
            file.write(f'{message!r}\n' if is_typed else f'{message.hex()}\n')

    return write


def _parse() -> Any:
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('--publish', type=Path)
    add('--take', type=Path)
    add('--made', metavar='PREFIX', help='types of descriptions: those that are installed there')
    add('--typed', action='store_true', help='take message objects, tell all of them')
    add('--describes', choices=['rightly', 'not', *SERVICES], default='rightly')
    add('--durability', default='transient_local')
    add('--readers', type=int, default=0, help='of each topic, to wait for before it publishes')
    add('--writers', type=int, default=0, help='of each topic, to wait for before it is ready')
    add('--name', default=f'robot_{os.getpid()}')
    return parser.parse_args()


if __name__ == '__main__':
    main()
