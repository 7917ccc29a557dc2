"""A node of the second DDS vendor that reads strings, or publishes them.

`read` appends them to a file, line by line, and prints `ready` when its reader is made. `write`
publishes `<number>`, `--count` times, as soon as a reader is there, prints `published N` when all
is acknowledged, and stays until it is told to end.
"""

import argparse
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# As ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST does for a ROS node.
THIS_MACHINE: Final = """
    <General>
      <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
      <AllowMulticast>false</AllowMulticast>
    </General>
    <Discovery>
      <ParticipantIndex>auto</ParticipantIndex>
      <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
      <Peers><Peer address="127.0.0.1"/></Peers>
    </Discovery>"""
KEPT: Final = (
    Policy.Durability.TransientLocal,
    Policy.DurabilityService(duration(), Policy.History.KeepAll, -1, -1, -1),
)


@dataclass
@annotations.final
class String_(IdlStruct, typename='std_msgs::msg::dds_::String_'):  # noqa: N801
    """What ROS calls std_msgs/msg/String."""

    data: str


@dataclass
@annotations.final
class Fine_(IdlStruct, typename='acme_tf::msg::dds_::Fine_'):  # noqa: N801
    """What ROS calls acme_tf/msg/Fine."""

    data: str


TYPES: Final = {'std_msgs/msg/String': String_, 'acme_tf/msg/Fine': Fine_}
"""By their names in ROS."""


def main() -> None:
    """Read or write in the domain of ROS_DOMAIN_ID, reliable and KEEP_ALL."""
    args = _parse()
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=10)),
        Policy.History.KeepAll,
        *(KEPT if args.latched else [Policy.Durability.Volatile]),
    )
    number = int(os.environ['ROS_DOMAIN_ID'])
    domain = Domain(number, THIS_MACHINE)
    participant = DomainParticipant(number)
    kind = TYPES[args.type]
    topic = Topic(participant, f'rt{args.topic}', kind, qos=qos)
    if args.part == 'read':
        _read(DataReader(participant, topic, qos=qos), kind, args.file)
    writer = DataWriter(participant, topic, qos=qos)
    _write(writer, kind, args)
    while domain and writer:  # a history goes with them
        time.sleep(1)


def _read(reader: Any, kind: type[Any], path: Path) -> None:
    print('ready', flush=True)
    with path.open('a', buffering=1) as file:
        while True:
            for sample in reader.take(N=100):
                if isinstance(sample, kind):  # others say that a writer has gone
                    file.write(f'{sample.data}\n')
            time.sleep(0.005)


def _write(writer: Any, kind: type[Any], args: Any) -> None:
    while not writer.get_matched_subscriptions():
        time.sleep(0.01)
    time.sleep(1.0)  # the writer knows of the match before the reader does
    for number in range(args.count):
        while args.leave and number >= int(args.leave.read_text()):
            time.sleep(0.01)
        sample = kind(data=str(number).ljust(args.bytes, '.'))
        writer.write(sample, timestamp=0 if args.timeless else None)
    writer.wait_for_acks(duration(seconds=20))
    print(f'published {args.count}', flush=True)


def _parse() -> Any:
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('part', choices=('read', 'write'))
    add('topic')
    add('--type', choices=TYPES, default='std_msgs/msg/String')
    add('--file', type=Path, help='where what is read goes')
    add('--count', type=int, help='of what is written')
    add('--bytes', type=int, default=0, help='of each at least: dots behind it')
    add('--latched', action='store_true', help='TRANSIENT_LOCAL')
    add('--leave', type=Path, help='publish as many as this file says, and wait')
    add('--timeless', action='store_true', help='send no time with them')
    return parser.parse_args()


if __name__ == '__main__':
    main()
