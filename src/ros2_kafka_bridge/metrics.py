"""What a route counts, and the snapshot of it that others may read."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple


class Outcome(StrEnum):
    """What became of a record or message that was taken. Each ends in exactly one."""

    CONFIRMED = 'confirmed'
    DEAD_LETTERED = 'dead_lettered'
    DROPPED = 'dropped'
    SKIPPED = 'skipped'
    RETURNED = 'returned'
    LOST = 'lost'  # on a damaged disk
    GIVEN_UP = 'given_up'  # in flight when another bridge took the route over


class State(StrEnum):
    """What a route is doing."""

    STARTING = 'starting'
    RUNNING = 'running'
    WAITING = 'waiting'
    FAILED = 'failed'
    STOPPED = 'stopped'


class Snapshot(NamedTuple):
    """The counters of one route at one moment, made by the route's own thread.

    `taken` equals the seven outcomes plus `spooled` plus `in_flight`, always. What an earlier life
    of the bridge has left on disk counts as taken when it is found. `spooled` waits on disk,
    `in_flight` is the length of what the route holds, not a difference. `lag` is in records
    (Kafka -> ROS only), `lost_upstream` what was lost before the bridge could take it, `repeated`
    what was published again. `final` says that the route has failed and is not tried again.
    """

    route: str
    state: State
    reason: str
    taken: int
    confirmed: int
    dead_lettered: int
    dropped: int
    skipped: int
    returned: int
    lost: int
    given_up: int
    spooled: int
    in_flight: int
    lost_upstream: int
    repeated: int
    lag: int | None
    final: bool = False

    @property
    def balanced(self) -> bool:
        """Whether everything taken is accounted for, and nothing counted below zero."""
        ended = [getattr(self, outcome) for outcome in Outcome]
        parts = [*ended, self.spooled, self.in_flight]
        rest = (self.lost_upstream, self.repeated)
        return bool(self.taken == sum(parts) and min(*parts, *rest) >= 0)


@dataclass(slots=True)
class Counters:
    """The counters of one route; only the route's own thread touches them."""

    route: str
    state: State = State.STARTING
    reason: str = ''
    taken: int = 0
    lost_upstream: int = 0
    repeated: int = 0
    ended: dict[Outcome, int] = field(default_factory=lambda: dict.fromkeys(Outcome, 0))

    def end(self, outcome: Outcome, count: int = 1) -> None:
        """Count `count` records or messages that ended in `outcome`."""
        self.ended[outcome] += count

    def tell(self, failure: str, obstacle: str) -> None:
        """Note what the route is doing: it has failed, it waits, or, both empty, it runs."""
        self.state = State.FAILED if failure else State.WAITING if obstacle else State.RUNNING
        self.reason = failure or obstacle

    def tell_end(self) -> None:
        """Note that the route does nothing any more."""
        self.state, self.reason = State.STOPPED, ''

    def snapshot(self, in_flight: int, lag: int | None = None, spooled: int = 0) -> Snapshot:
        """Freeze the counters; `in_flight` is the length of what the route holds now."""
        return Snapshot(
            route=self.route,
            state=self.state,
            reason=self.reason,
            taken=self.taken,
            confirmed=self.ended[Outcome.CONFIRMED],
            dead_lettered=self.ended[Outcome.DEAD_LETTERED],
            dropped=self.ended[Outcome.DROPPED],
            skipped=self.ended[Outcome.SKIPPED],
            returned=self.ended[Outcome.RETURNED],
            lost=self.ended[Outcome.LOST],
            given_up=self.ended[Outcome.GIVEN_UP],
            spooled=spooled,
            in_flight=in_flight,
            lost_upstream=self.lost_upstream,
            repeated=self.repeated,
            lag=lag,
        )


def to_line(snapshots: Iterable[Snapshot]) -> bytes:
    """Write snapshots as one line of JSON, as a worker sends them."""
    return json.dumps({'snapshots': [s._asdict() for s in snapshots]}).encode() + b'\n'


def from_line(line: bytes) -> list[Snapshot]:
    """Read snapshots from a line of JSON."""
    found = json.loads(line)['snapshots']
    return [Snapshot(**{**fields, 'state': State(fields['state'])}) for fields in found]
