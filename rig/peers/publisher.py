"""Any user's node that publishes on one topic; waits when its history is full.

It publishes std_msgs/String with numbers, or with `--file` the messages of a type, each as CDR
bytes in hex on a line. Prints its gid, `ready` when it begins, `held back from N` where the next
one, number N, has to wait, and `published N` when all is out; then it stays until it is told to
end: a TRANSIENT_LOCAL publisher keeps its history as long as it lives. With `--leave FILE` the
size of `FILE.out` is how many are out.
"""

import argparse
import itertools
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message

from rig.peers.ends import has_published, kind_of, qos, wait_for_readers
from rig.peers.pace import STEP_S, paced

_ACKNOWLEDGED_S: Final = 60


def main() -> None:
    """Publish `--count` messages, those of the file, or until a file is there."""
    args = _parse()
    rclpy.init()
    node = rclpy.create_node(f'publisher_{os.getpid()}')
    kind = kind_of(args.type)
    profile = qos(args.durability, args.reliability, args.depth)
    publisher = node.create_publisher(kind, args.topic, profile)
    [gid] = [
        bytes(info.endpoint_gid)[:16].hex()
        for info in node.get_publishers_info_by_topic(args.topic)
        if info.node_name == node.get_name()
    ]
    print(f'gid {gid}', flush=True)
    wait_for_readers([publisher], args.readers)
    print('ready', flush=True)
    published = 0
    # A byte for each that is out: how long it is cannot be read half written.
    out = args.leave and args.leave.with_suffix('.out').open('ab', buffering=0)
    for message in paced(_messages(args, kind), args.rate, args.leave, args.until):
        _publish(publisher, message, published)
        published += 1
        if out:
            out.write(b'.')
    if args.acknowledged:
        publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))
    print(f'published {published}', flush=True)
    while rclpy.ok():
        time.sleep(0.05)


def _messages(args: Any, kind: Any) -> Iterator[Any]:
    if args.file is None:
        numbers = itertools.count() if args.count is None else range(args.count)
        return (kind(data=f'{args.prefix}{number}'.ljust(args.size)) for number in numbers)
    sent: Sequence[bytes] = [bytes.fromhex(line) for line in args.file.read_text().split()]
    made = [deserialize_message(cdr, kind) if args.typed else cdr for cdr in sent]
    return itertools.chain.from_iterable(itertools.repeat(made, args.times))


def _publish(publisher: Any, message: Any, number: int) -> None:
    if has_published(publisher, message):
        return
    print(f'held back from {number}', flush=True)
    while not has_published(publisher, message):
        time.sleep(STEP_S)


def _parse() -> Any:
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('topic')
    add('--type', default='std_msgs/msg/String')
    add('--file', type=Path, help='publish these, in hex, a line each')
    add('--times', type=int, default=1, help='publish the file so many times')
    add('--typed', action='store_true', help='as message objects, not as bytes')
    add('--count', type=int, help='without it, and without a file, until --until')
    add('--until', type=Path, help='publish until this file is there')
    add('--leave', type=Path, help='publish as many as this file says, and wait')
    add('--rate', type=float, default=0.0, help='messages/s, 0 is no limit')
    add('--prefix', default='', help='of the numbers')
    add('--size', type=int, default=0, help='pad each number to so many characters')
    add('--reliability', default='reliable')
    add('--durability', default='volatile')
    add('--depth', type=int, default=0, help='KEEP_LAST of so many; 0: KEEP_ALL')
    add('--readers', type=int, default=1, help='wait for so many first')
    add('--acknowledged', action='store_true', help='wait for that before all is out')
    return parser.parse_args()


if __name__ == '__main__':
    main()
