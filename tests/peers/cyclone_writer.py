"""A node of the second DDS vendor that publishes std_msgs/String: `<number>`, `--count` times.

Prints `published N` when all is acknowledged, then stays until it is told to end.
"""

import argparse
import time
from pathlib import Path

from cyclone import TYPES, join  # type: ignore[import-not-found]  # beside this script
from cyclonedds.pub import DataWriter
from cyclonedds.util import duration


def main() -> None:
    """Publish numbers as soon as a reader is there."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('--count', type=int, required=True)
    parser.add_argument('--bytes', type=int, default=0, help='of each at least: dots behind it')
    parser.add_argument('--latched', action='store_true', help='TRANSIENT_LOCAL')
    parser.add_argument('--leave', type=Path, help='publish as many as this file says, and wait')
    parser.add_argument('--timeless', action='store_true', help='send no time with them')
    parser.add_argument('--type', choices=TYPES, default='std_msgs/msg/String')
    args = parser.parse_args()

    joined = join(args.topic, args.type, latched=args.latched)
    writer = DataWriter(joined.participant, joined.topic, qos=joined.qos)
    while not writer.get_matched_subscriptions():
        time.sleep(0.01)
    time.sleep(1.0)  # the writer knows of the match before the reader does
    for number in range(args.count):
        while args.leave and number >= int(args.leave.read_text()):
            time.sleep(0.01)
        sample = TYPES[args.type](data=str(number).ljust(args.bytes, '.'))
        writer.write(sample, timestamp=0 if args.timeless else None)
    writer.wait_for_acks(duration(seconds=20))
    print(f'published {args.count}', flush=True)  # noqa: T201
    while True:
        time.sleep(1)


main()
