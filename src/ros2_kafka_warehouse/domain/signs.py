"""The signs of a robot, or of the whole fleet: what stands as evidence now, each under a key."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ros2_kafka_warehouse.domain.robot_failure_profile import Evidence

if TYPE_CHECKING:
    from ros2_kafka_warehouse.domain.robot_failure_profile import Fact

CONTACT: Final = 'contact'
NO_PROGRESS: Final = 'no_progress'
SLOW: Final = 'slow'
STUCK: Final = 'stuck'
BATTERY: Final = 'battery'


class Signs:
    """The evidence that stands now, each under a key; some of it lasts only until a time."""

    __slots__ = ('changed', 'ends', 'evidence')

    def __init__(self) -> None:
        self.evidence: dict[str, Evidence] = {}
        self.ends: dict[str, float] = {}
        self.changed = False

    def __contains__(self, key: str) -> bool:
        return key in self.evidence

    def show(
        self, key: str, sign: str, text: str, until_s: float | None = None, **facts: Fact
    ) -> None:
        """Note that something is seen."""
        self.evidence[key] = Evidence(sign, text, facts)
        self.changed = True
        if until_s is not None:
            self.ends[key] = until_s

    def clear(self, key: str) -> None:
        """Note that it is no longer seen."""
        if self.evidence.pop(key, None) is not None:
            self.ends.pop(key, None)
            self.changed = True

    def expire(self, now_s: float) -> None:
        """Clear what lasted only until now."""
        for key in [key for key, end_s in self.ends.items() if end_s <= now_s]:
            self.clear(key)
