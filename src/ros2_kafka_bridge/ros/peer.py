"""An endpoint of others in the ROS graph."""

from typing import Any, Final, NamedTuple

BRIDGE_PREFIX: Final = 'kafka_bridge_'
"""What the name of a bridge's node begins with."""


class Peer(NamedTuple):
    """An endpoint of the graph.

    Args:
        node: Name of its node with its namespace.
        gid: 16 bytes.
        type_hash: REP-2011, empty where it is not told.
        reliability: `reliable` or `best_effort`.
        durability: `volatile` or `transient_local`.
        qos: All of it, as rclpy has it.
    """

    node: str
    message_type: str
    gid: bytes
    type_hash: str
    reliability: str
    durability: str
    qos: Any

    @property
    def named(self) -> bool:
        """Whether the graph knows its node: it tells a moment after the endpoint."""
        return '_NODE_NAME_UNKNOWN_' not in self.node

    @property
    def is_bridge(self) -> bool:
        """Whether it belongs to a bridge, this one or another."""
        return self.node.rpartition('/')[2].startswith(BRIDGE_PREFIX)

    def misreads(self, name: str, type_hash: str | None) -> bool:
        """Whether it would read messages of that type and definition into other fields.

        Only where both tell what theirs is, by the same version of REP-2011; and a bridge does
        not, it carries the bytes or refuses them.
        """
        if not type_hash or not self.type_hash or self.message_type != name or self.is_bridge:
            return False
        (version, _, fields), (there, _, others) = (
            told.partition('_') for told in (type_hash, self.type_hash)
        )
        return version == there and fields != others

    @classmethod
    def of_qos(cls, node: str, message_type: str, gid: bytes, type_hash: str, qos: Any) -> 'Peer':
        """Make it of rclpy's QoS."""
        latched = qos.durability.name == 'TRANSIENT_LOCAL'
        return cls(
            node=node,
            message_type=message_type,
            gid=gid,
            type_hash=type_hash,
            reliability='best_effort' if qos.reliability.name == 'BEST_EFFORT' else 'reliable',
            durability='transient_local' if latched else 'volatile',
            qos=qos,
        )
