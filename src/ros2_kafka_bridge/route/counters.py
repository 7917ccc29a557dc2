"""What a route counts, and the snapshot of it that others may read."""

import operator
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

import msgspec


class Outcome(StrEnum):
    """What became of a record or message that was taken. Each ends in exactly one."""

    CONFIRMED = 'confirmed'
    PUBLISHED = 'published'  # to ROS, where nothing tells what has arrived
    DEAD_LETTERED = 'dead_lettered'
    DROPPED = 'dropped'
    SKIPPED = 'skipped'
    RETURNED = 'returned'
    LOST = 'lost'  # on a damaged disk
    GIVEN_UP = 'given_up'  # in flight at an end, of a topic that is gone or of a route handed over


class State(StrEnum):
    """What a route is doing."""

    STARTING = 'starting'
    RUNNING = 'running'
    WAITING = 'waiting'
    PAUSED = 'paused'
    FAILED = 'failed'
    STOPPED = 'stopped'


BOUNDS_S: Final = (
    0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0,
    300.0,
)  # fmt: skip
"""Upper bounds of the buckets of every `Distribution`, in seconds; the last bucket has none."""

MOST_TROUBLES: Final = 20
"""How many different errors a route remembers."""


class Distribution(NamedTuple):
    """How long something took, counted in buckets.

    Args:
        counts: How many fell into each bucket, one more than there are bounds; not cumulated.
        sum_s: All of them together.
    """

    counts: tuple[int, ...] = (0,) * (len(BOUNDS_S) + 1)
    sum_s: float = 0.0

    def plus(self, other: 'Distribution') -> 'Distribution':
        """Both together."""
        counts = tuple(map(operator.add, self.counts, other.counts))
        return Distribution(counts, self.sum_s + other.sum_s)


class Trouble(NamedTuple):
    """An error as a person would be told it.

    Args:
        time_s: When it came last, since 1970.
        error: Its class in `errors.py` (`DecodeError`).
        text: What happened, where, and what to do.
        times: How often it came, as far as it was the same.
    """

    time_s: float
    error: str
    text: str
    times: int = 1


class Measures(NamedTuple):
    """What a route measures beside its counters.

    What says how something is now is None where that is not known: of a route that does not run,
    nobody tells.

    Args:
        bytes_taken: Of values of records, or CDR bytes of messages.
        bytes_confirmed: Of what was confirmed, as it was taken; what has come back from disk
            counts with the length of its record's value.
        bytes_published: Of what was published and never is confirmed, as it was taken.
        errors: How many of each class of `errors.py`.
        waited_s: For how long the sink held the route back.
        rebalances: How often partitions came or went (Kafka -> ROS).
        kafka_up: Whether Kafka answers the route; None where it asks nothing of Kafka, or has
            heard nothing yet.
        matched: DDS endpoints that match the route's own, now.
        mismatched: DDS endpoints on its topic that do not match, now.
        queued: What the sink holds: the history of the writer, the queue of the producer.
        queue_limit: How much it may hold; None also where that has no limit.
        spool_bytes: What waits on disk; None until the file was opened.
        published: From the take to the publication (Kafka -> ROS).
        in_bridge: From the take to the confirmation.
        end_to_end: From the record's own time, or that of its publisher, to its publication in
            ROS, or its confirmation by Kafka.
        round_trip: From `produce` to the delivery report (ROS -> Kafka).
        broker_round_trip_s: As librdkafka measures it: the 50th and 99th percentile of the last
            seconds, the largest of all brokers; None where it has not. ROS -> Kafka only, for
            the requests of a consumer wait for records; and only in a bridge with `monitoring:`.
        troubles: The last different errors, newest last, at most 20.
    """

    bytes_taken: int = 0
    bytes_confirmed: int = 0
    errors: dict[str, int] = {}  # noqa: RUF012 (never changed)
    waited_s: float = 0.0
    rebalances: int = 0
    kafka_up: bool | None = None
    matched: int | None = None
    mismatched: int | None = None
    queued: int | None = None
    queue_limit: int | None = None
    spool_bytes: int | None = None
    published: Distribution = Distribution()
    in_bridge: Distribution = Distribution()
    end_to_end: Distribution = Distribution()
    round_trip: Distribution = Distribution()
    broker_round_trip_s: tuple[float, float] | None = None
    troubles: tuple[Trouble, ...] = ()
    bytes_published: int = 0

    def plus(self, now: 'Measures') -> 'Measures':
        """Add what was measured later; what is a state and no sum is as it is now."""
        return now._replace(
            bytes_taken=self.bytes_taken + now.bytes_taken,
            bytes_confirmed=self.bytes_confirmed + now.bytes_confirmed,
            bytes_published=self.bytes_published + now.bytes_published,
            errors={
                error: self.errors.get(error, 0) + now.errors.get(error, 0)
                for error in self.errors | now.errors
            },
            waited_s=self.waited_s + now.waited_s,
            rebalances=self.rebalances + now.rebalances,
            published=self.published.plus(now.published),
            in_bridge=self.in_bridge.plus(now.in_bridge),
            end_to_end=self.end_to_end.plus(now.end_to_end),
            round_trip=self.round_trip.plus(now.round_trip),
            troubles=_last_of((*self.troubles, *now.troubles)),
        )

    @property
    def bytes_carried(self) -> int:
        """Of what has come on, as `Snapshot.carried` counts it."""
        return self.bytes_confirmed + self.bytes_published

    @property
    def delay(self) -> Distribution:
        """From the take to the publication in ROS, or to the confirmation by Kafka.

        A confirmation from ROS says nothing of it: it is seen late where messages are few.
        """
        return self.published if any(self.published.counts) else self.in_bridge

    @property
    def at_rest(self) -> 'Measures':
        """Without what only a route that runs can tell."""
        return self._replace(
            kafka_up=None, matched=None, mismatched=None, queued=None, queue_limit=None,
            broker_round_trip_s=None,
        )  # fmt: skip


_NOTHING: Final = Measures()


def _last_of(troubles: Iterable[Trouble]) -> tuple[Trouble, ...]:
    last: dict[tuple[str, str], Trouble] = {}
    for trouble in sorted(troubles):
        before = last.pop((trouble.error, trouble.text), None)
        times = trouble.times + (before.times if before is not None else 0)
        last[trouble.error, trouble.text] = trouble._replace(times=times)
    return tuple(last.values())[-MOST_TROUBLES:]


class Snapshot(NamedTuple):
    """The counters of one route at one moment, made by the route's own thread.

    `taken` equals the eight outcomes plus `spooled` plus `in_flight`, always. What an earlier life
    of the bridge has left on disk counts as taken when it is found. `spooled` waits on disk, None
    until the file was opened: then nothing of it is in `taken`. `in_flight` is the length of what
    the route holds, not a difference. `lag` is in records (Kafka -> ROS only), `lost_upstream`
    what was lost before the bridge could take it, `repeated` what was published again, `unproved`
    what was sent though a record in Kafka had its number.
    `memory_limit` is how many bytes of memory the route may take, None before that is known.
    `final` says that the route has failed and is not tried again.
    `made_s` is when it was made, by the monotonic clock that all processes of a machine share; 0
    where the route has told nothing.
    `beat_s` is when the route's thread was seen at work last, by that clock; 0 while it waits on
    purpose (for its next try, its turn, a type) or has ended.
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
    spooled: int | None
    in_flight: int
    lost_upstream: int
    repeated: int
    lag: int | None
    final: bool = False
    made_s: float = 0.0
    beat_s: float = 0.0
    measures: Measures = Measures()
    unproved: int = 0
    published: int = 0
    memory_limit: int | None = None

    @property
    def carried(self) -> int:
        """What has come on: confirmed, or published where nothing can confirm it."""
        return self.confirmed + self.published

    @property
    def balanced(self) -> bool:
        """Whether everything taken is accounted for, and nothing counted below zero."""
        ended = [getattr(self, outcome) for outcome in Outcome]
        parts = [*ended, self.spooled or 0, self.in_flight]
        rest = (self.lost_upstream, self.repeated, self.unproved)
        return bool(self.taken == sum(parts) and min(*parts, *rest) >= 0)

    @property
    def at_rest(self) -> 'Snapshot':
        """As it is told of a route that does not run, and need show no life."""
        return self._replace(beat_s=0.0, lag=None, measures=self.measures.at_rest)


@dataclass(slots=True)
class Counters:
    """The counters of one route; only the route's own thread touches them."""

    route: str
    state: State = State.STARTING
    reason: str = ''
    taken: int = 0
    lost_upstream: int = 0
    repeated: int = 0
    unproved: int = 0
    memory_limit: int | None = None
    ended: dict[Outcome, int] = field(default_factory=lambda: dict.fromkeys(Outcome, 0))

    def end(self, outcome: Outcome, count: int = 1) -> None:
        """Count `count` records or messages that ended in `outcome`."""
        self.ended[outcome] += count

    def tell(self, failure: str, obstacle: str, pause: str = '', *, begun: bool = True) -> None:
        """Note what the route is doing: it has failed, pauses, waits, or, all empty, it runs.

        Until it has `begun` it only starts.
        """
        if failure:
            self.state = State.FAILED
        elif pause:
            self.state = State.PAUSED
        elif not begun:
            self.state = State.STARTING
        else:
            self.state = State.WAITING if obstacle else State.RUNNING
        self.reason = failure or pause or obstacle

    def tell_end(self) -> None:
        """Note that the route does nothing any more."""
        self.state, self.reason = State.STOPPED, ''

    @property
    def nothing_told(self) -> Snapshot:
        """What is known of a route that has told nothing: none is stuck, either."""
        return self.snapshot(0)._replace(made_s=0.0, beat_s=0.0)

    def snapshot(
        self,
        in_flight: int,
        lag: int | None = None,
        spooled: int | None = None,
        measures: Measures = _NOTHING,
    ) -> Snapshot:
        """Freeze the counters; `in_flight` is the length of what the route holds now."""
        now_s = time.monotonic()
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
            made_s=now_s,
            beat_s=0.0 if self.state is State.STOPPED else now_s,
            measures=measures,
            unproved=self.unproved,
            published=self.ended[Outcome.PUBLISHED],
            memory_limit=self.memory_limit,
        )


def to_line(snapshots: Iterable[Snapshot]) -> bytes:
    """Write snapshots as one line of JSON, as a worker sends them."""
    return msgspec.json.encode(list(snapshots)) + b'\n'


def from_line(line: bytes) -> list[Snapshot]:
    """Read snapshots from a line of JSON.

    Raises:
        ValueError: It is none.
    """
    return _SNAPSHOTS.decode(line)


_SNAPSHOTS: Final = msgspec.json.Decoder(list[Snapshot])  # no thread makes it while another does
