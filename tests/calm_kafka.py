"""A Kafka that tests share and leave running."""

from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

# Properties of a Kafka that is never killed: it outlives a machine that stands still for seconds,
# and tells less often that it lives, which alone took 4 % of a core.
CALM: Final = MappingProxyType(
    {
        'broker.heartbeat.interval.ms': '2000',
        'broker.session.timeout.ms': '10000',
        'metadata.max.idle.interval.ms': '5000',
    }
)


class SharedKafka(NamedTuple):
    """Where the Kafka is that all tests of a run share.

    Args:
        bootstrap_servers: Where clients find it.
        directory: Where it keeps data, configuration and log.
    """

    bootstrap_servers: str
    directory: Path

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.bootstrap_servers.rpartition(':')[2])
