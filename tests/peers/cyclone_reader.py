"""A node of the second DDS vendor that reads strings; appends them to a file, line by line.

Prints `ready` when its reader is made.
"""

import argparse
import time
from pathlib import Path

from cyclone import TYPES, join  # type: ignore[import-not-found]  # beside this script
from cyclonedds.sub import DataReader


def main() -> None:
    """Read until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('file', type=Path)
    parser.add_argument('--type', choices=TYPES, default='std_msgs/msg/String')
    args = parser.parse_args()

    joined = join(args.topic, args.type)
    reader = DataReader(joined.participant, joined.topic, qos=joined.qos)
    print('ready', flush=True)  # noqa: T201
    with args.file.open('a', buffering=1) as file:
        while True:
            for sample in reader.take(N=100):
                if isinstance(sample, TYPES[args.type]):  # others say that a writer has gone
                    file.write(f'{sample.data}\n')
            time.sleep(0.005)


main()
