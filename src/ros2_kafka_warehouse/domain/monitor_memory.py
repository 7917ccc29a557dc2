"""What the Monitor remembers over a restart, in its report."""

from hashlib import sha256

import msgspec

from ros2_kafka_warehouse.domain.failures import Failure
from ros2_kafka_warehouse.domain.robot_failure_profile import Evidence
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport


class SignsKept(msgspec.Struct, rename='camel', omit_defaults=True):
    """The evidence that stands on one robot."""

    evidence: dict[str, Evidence]
    ends: dict[str, float] = msgspec.field(default_factory=dict)


class Memory(msgspec.Struct, rename='camel', omit_defaults=True):
    """What the Monitor has to know again after a restart, beside what its report says anyway.

    Attributes:
        sequence: Number of the last event.
        failures: All that have not ended.
        signs: Evidence that stands, by robot.
        history: When each robot had failures: (code, seconds).
        block_tries: How often a cell was found blocked, by node.
        charger_until: Until when a charger is not used, by node.
        commands: Ids of the commands that were done, the newest last.
        paused: Why all stand by an operator's word, or ''.
        violation: The rule that was broken and not acknowledged yet, or ''.
        violations_seen: Violations that were acknowledged.
        paused_robots: Those that were told to pause.
        removed: Robots that were taken off the floor: True when told to come back.
        missing: Robots that are not heard of: since when, and the node that they may drive to.
        events: Those that the last judgement has given.
        site: A fingerprint of the site that all this is about.
    """

    sequence: int = 0
    failures: list[Failure] = msgspec.field(default_factory=list)
    signs: dict[str, SignsKept] = msgspec.field(default_factory=dict)
    history: dict[str, list[tuple[str, float]]] = msgspec.field(default_factory=dict)
    block_tries: dict[str, int] = msgspec.field(default_factory=dict)
    charger_until: dict[str, float] = msgspec.field(default_factory=dict)
    commands: list[str] = msgspec.field(default_factory=list)
    paused: str = ''
    violation: str = ''
    violations_seen: list[str] = msgspec.field(default_factory=list)
    paused_robots: list[str] = msgspec.field(default_factory=list)
    removed: dict[str, bool] = msgspec.field(default_factory=dict)
    rejoining: dict[str, float] = msgspec.field(default_factory=dict)
    missing: dict[str, tuple[float, str]] = msgspec.field(default_factory=dict)
    events: list[FailureEvent] = msgspec.field(default_factory=list)
    site: str = ''


def memory_of(report: FleetReport) -> Memory:
    """What the Monitor of a report remembered."""
    return msgspec.json.decode(report.memory, type=Memory) if report.memory else Memory()


def fingerprint(site: Site) -> str:
    """What tells a site from others: its map and its robots."""
    robots = sorted(site.robots.items())
    return sha256(msgspec.json.encode((site.rows, robots))).hexdigest()[:16]
