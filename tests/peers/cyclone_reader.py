"""A node of the second DDS vendor that reads std_msgs/String; appends it to a file, line by line.

Prints `ready` when its reader is made.
"""

import argparse
import time
from pathlib import Path

from cyclone import String_, join  # type: ignore[import-not-found]  # beside this script
from cyclonedds.sub import DataReader


def main() -> None:
    """Read until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('file', type=Path)
    args = parser.parse_args()

    joined = join(args.topic)
    reader = DataReader(joined.participant, joined.topic, qos=joined.qos)
    print('ready', flush=True)  # noqa: T201
    with args.file.open('a', buffering=1) as file:
        while True:
            for sample in reader.take(N=100):
                if isinstance(sample, String_):  # others say that a writer has gone
                    file.write(f'{sample.data}\n')
            time.sleep(0.005)


main()
