"""A node of the second DDS vendor that publishes std_msgs/String: `<number>`, `--count` times.

Prints `published N` when all is acknowledged, then stays until it is told to end.
"""

import argparse
import os
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
from cyclonedds.pub import DataWriter
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
    """Publish numbers as soon as a reader is there."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('--count', type=int, required=True)
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
    writer = DataWriter(participant, topic, qos=qos)
    while not writer.get_matched_subscriptions():
        time.sleep(0.01)
    time.sleep(0.5)  # the writer knows of the match before the reader does
    for number in range(args.count):
        writer.write(String_(data=str(number)))
    writer.wait_for_acks(duration(seconds=20))
    print(f'published {args.count}', flush=True)  # noqa: T201
    while True:
        time.sleep(1)


main()
