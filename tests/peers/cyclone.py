"""A participant of the second DDS vendor, with a topic of std_msgs/String, or of one like it."""

import os
from dataclasses import dataclass
from typing import Any, NamedTuple

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
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


@dataclass
@annotations.final
class Fine_(IdlStruct, typename='acme_tf::msg::dds_::Fine_'):  # noqa: N801
    """What ROS calls acme_tf/msg/Fine."""

    data: str


TYPES = {'std_msgs/msg/String': String_, 'acme_tf/msg/Fine': Fine_}
"""By their names in ROS."""


class Joined(NamedTuple):
    """What a reader or a writer is made with.

    Args:
        domain: Kept, because its settings go with it.
    """

    domain: Domain
    participant: DomainParticipant
    topic: Topic[Any]
    qos: Qos


def join(ros_topic: str, message_type: str, *, latched: bool = False) -> Joined:
    """Join the domain of ROS_DOMAIN_ID, reliable, KEEP_ALL, volatile if not latched."""
    kept = [
        Policy.Durability.TransientLocal,
        Policy.DurabilityService(duration(), Policy.History.KeepAll, -1, -1, -1),
    ]
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=10)),
        Policy.History.KeepAll,
        *(kept if latched else [Policy.Durability.Volatile]),
    )
    number = int(os.environ['ROS_DOMAIN_ID'])
    domain = Domain(number, THIS_MACHINE)
    participant = DomainParticipant(number)
    topic = Topic(participant, f'rt{ros_topic}', TYPES[message_type], qos=qos)
    return Joined(domain, participant, topic, qos)
