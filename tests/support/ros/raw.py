"""Publishers and readers of CDR bytes, their routes to Kafka, and what has arrived."""

import struct
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from confluent_kafka import Message
from support.bridges.routes import lines, values
from support.formats.messages import exact_of
from support.processes.harness import Bench, Process, eventually, headers

STRING = 'std_msgs/msg/String'


def text(data: bytes, order: str = '<') -> bytes:
    """The CDR bytes of a std_msgs/String."""
    header = b'\0\1\0\0' if order == '<' else b'\0\0\0\0'
    return header + struct.pack(f'{order}I', len(data) + 1) + data + b'\0'


def publish(
    bench: Bench,
    topic: str,
    messages: Sequence[bytes],
    *options: str,
    message_type: str = STRING,
) -> Process:
    """Start a node that publishes CDR bytes."""
    file = bench.place / f'{time.monotonic_ns()}.hex'
    file.write_text('\n'.join(message.hex() for message in messages))
    words = '--type', message_type, '--file', str(file)
    return bench.publisher(topic, *words, *options)


def route(
    ros: str, kafka: str, message_type: str | None, name: str, **sink: Any
) -> dict[str, Any]:
    """A route ROS -> Kafka as cdr."""
    source = {'ros': ros} if message_type is None else {'ros': ros, 'type': message_type}
    return {'name': name, 'from': source, 'to': {'kafka': kafka, **sink}, 'format': 'cdr'}


def identities(records: Sequence[Message]) -> list[tuple[str, int]]:
    """Publisher and number of each record."""
    found = [headers(record) for record in records]
    return [(header['ros.gid'], int(header['ros.seq'])) for header in found]


def of(prefix: bytes, records: Sequence[Message]) -> list[bytes]:
    """The values that begin so, in the order of the topic."""
    return [value for value in values(list(records)) if value.startswith(prefix)]


def reader_of(bench: Bench, message_type: str, topic: str = '/out') -> Process:
    """A subscriber of one topic, ready; what it reads comes into the file `received`."""
    file = str(bench.place / 'received')
    with ExitStack() as stack:
        words = topic, file, '--type', message_type, '--form', 'hex'
        reader = stack.enter_context(bench.peer('subscriber', *words))
        reader.wait_for('ready')
        stack.pop_all()
    return reader


def received(bench: Bench, count: int, bridge: Process, message_type: str) -> list[bytes]:
    """What the reader has got, once that are so many messages."""
    file = bench.place / 'received'
    eventually(lambda: len(lines(file)) >= count, 60, bridge.output)
    return [exact_of(message_type)(bytes.fromhex(line)) for line in lines(file)]
