"""How bridges can be members of Kafka's groups, to be compared under the same faults."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple


class Membership(NamedTuple):
    """One way to be a member.

    Args:
        name: For the command line.
        words: For the table.
        bridge: Fields of the bridge's configuration.
        client: librdkafka properties of the bridge.
        broker: Properties of every broker.
    """

    name: str
    words: str
    bridge: Mapping[str, Any] = MappingProxyType({})
    client: Mapping[str, Any] = MappingProxyType({})
    broker: Mapping[str, str] = MappingProxyType({})


_KIP_848: Final = MappingProxyType({'group.protocol': 'consumer'})
_QUICK: Final = MappingProxyType(
    {
        'group.consumer.min.session.timeout.ms': '6000',
        'group.consumer.session.timeout.ms': '6000',
        'group.consumer.min.heartbeat.interval.ms': '2000',
        'group.consumer.heartbeat.interval.ms': '2000',
    }
)

MEMBERSHIPS: Final[Mapping[str, Membership]] = MappingProxyType(
    {
        membership.name: membership
        for membership in (
            Membership('static', 'static, session 6 s', {'membership': 'static'}),
            Membership('dynamic', 'dynamic, session 6 s', {'membership': 'dynamic'}),
            Membership('consumer', 'KIP-848, session 45 s (default)', client=_KIP_848),
            Membership('consumer_6s', 'KIP-848, session 6 s', client=_KIP_848, broker=_QUICK),
        )
    }
)
