"""Any user's node that reads a topic; appends what it gets to a file.

It is written before the next message is taken, so a SIGKILL shows exactly what had arrived.
"""

import argparse
import hashlib
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from rig.peers.ends import kind_of, qos

DIGEST_BYTES: Final = 8


def digest(cdr: bytes) -> bytes:
    """Hash a message without its header and without the zeros that may pad it."""
    return hashlib.blake2b(cdr[4:].rstrip(b'\0'), digest_size=DIGEST_BYTES).digest()


FORMS: Final[Mapping[str, Callable[[Any], bytes]]] = MappingProxyType(
    {
        'text': lambda message: message.data.encode() + b'\n',
        'hex': lambda cdr: cdr.hex().encode() + b'\n',
        'hash': digest,
    }
)
"""How a message is written: text is that of a std_msgs/String, the others are of its bytes."""


def main() -> None:
    """Read a topic until told to end; prints `ready` when the subscription is made."""
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('topic')
    add('file', type=Path)
    add('--type', default='std_msgs/msg/String')
    add('--form', choices=FORMS, default='text')
    add('--reliability', default='reliable')
    add('--durability', default='volatile')
    add('--depth', type=int, default=0, help='KEEP_LAST of so many; 0: KEEP_ALL')
    add('--leave', type=Path, help='take as many as this file says, and wait')
    add('--work', type=float, default=0.0, help='seconds of work for a message')
    args = parser.parse_args()

    rclpy.init()
    node = rclpy.create_node(f'subscriber_{os.getpid()}')
    form = FORMS[args.form]
    taken = 0
    with args.file.open('ab', buffering=0) as file, suppress(ExternalShutdownException):

        def on_message(message: Any) -> None:
            nonlocal taken
            taken += 1
            file.write(form(message))
            if args.work:
                time.sleep(args.work)

        profile = qos(args.durability, args.reliability, args.depth)
        raw = args.form != 'text'
        node.create_subscription(kind_of(args.type), args.topic, on_message, profile, raw=raw)
        print('ready', flush=True)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while True:
            if args.leave and taken >= int(args.leave.read_text()):
                time.sleep(0.01)
            else:
                executor.spin_once(timeout_sec=1.0)


if __name__ == '__main__':
    main()
