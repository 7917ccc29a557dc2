"""A node of the second DDS vendor that reads std_msgs/String; appends it to a file, line by line.

Prints `ready` when its reader is made.
"""

import argparse
import os
import time
from dataclasses import dataclass
from pathlib import Path

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# As ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST does for a ROS node.
THIS_MACHINE = """
    <General>
      <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
      <AllowMulticast>false</AllowMulticast>
    </General>
    <Discovery>
      <ParticipantIndex>auto</ParticipantIndex>
      <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
      <Peers><Peer address="127.0.0.1"/></Peers>
    </Discovery>"""


@dataclass
@annotations.final
class String_(IdlStruct, typename='std_msgs::msg::dds_::String_'):  # noqa: N801
    """What ROS calls std_msgs/msg/String."""

    data: str


def main() -> None:
    """Read until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('file', type=Path)
    args = parser.parse_args()

    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=10)),
        Policy.History.KeepAll,
        Policy.Durability.Volatile,
    )
    number = int(os.environ['ROS_DOMAIN_ID'])
    _domain = Domain(number, THIS_MACHINE)  # kept: its settings go with it
    participant = DomainParticipant(number)
    topic = Topic(participant, f'rt{args.topic}', String_, qos=qos)
    reader = DataReader(participant, topic, qos=qos)
    print('ready', flush=True)  # noqa: T201
    with args.file.open('a', buffering=1) as file:
        while True:
            for sample in reader.take(N=100):
                if isinstance(sample, String_):  # others say that a writer has gone
                    file.write(f'{sample.data}\n')
            time.sleep(0.005)


main()
