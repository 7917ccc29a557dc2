"""All kinds of faults, by name."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from benchmarks.faults.kinds import bridge, broker, disk, members, network, records, robots
from benchmarks.faults.kinds.fault import Fault

_OF: Final = (broker, bridge, network, disk, robots, members, records)

# A seed draws from them in this order.
FAULTS: Final[Mapping[str, Fault]] = MappingProxyType(
    {fault.name: fault for kind in _OF for fault in kind.FAULTS}
)
