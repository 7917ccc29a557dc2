"""What a route has counted, over all the times that this bridge has run it."""

from typing import NamedTuple, Self

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.route.counters import Counters, Measures, Snapshot, State
from ros2_kafka_bridge.route.measuring import Troubles
from ros2_kafka_bridge.wiring import Pipeline


class Totals(NamedTuple):
    """What a route has counted in its former runs, and what counts now.

    Args:
        before: The former runs together, with the failures of all.
        pipeline: What runs the route now, or is to be run again.
    """

    before: Snapshot
    pipeline: Pipeline | None = None

    @classmethod
    def of(cls, route: str, *, has_spool: bool = False) -> Self:
        """Those of a route that has not run: what lies in its spool is not known."""
        on_disk = None if has_spool else 0
        measures = Measures(spool_bytes=on_disk)
        return cls(Counters(route).snapshot(0, spooled=on_disk, measures=measures))

    @property
    def now(self) -> Snapshot:
        """All together."""
        if self.pipeline is None:
            return self.before
        return _sum(self.before, self.pipeline.snapshot)

    def used(self, pipeline: Pipeline | None) -> Self:
        """What runs the route from now on is this."""
        return self.__class__(_without_spooled(self.before), pipeline)

    def given_up(self) -> Self:
        """What has run the route is no more, and what it still held is held by nobody."""
        return self.__class__(_given_up(self.now))

    def troubled(self, error: BridgeError) -> Self:
        """The route has failed."""
        troubles = Troubles()
        troubles.note(error)
        measures = self.before.measures.plus(troubles.measures())
        return self._replace(before=self.before._replace(measures=measures))


_SUMMED = [name for name, kind in Snapshot.__annotations__.items() if kind is int]


def _sum(before: Snapshot, now: Snapshot) -> Snapshot:
    sums = {name: getattr(before, name) + getattr(now, name) for name in _SUMMED}
    return now._replace(**sums, measures=before.measures.plus(now.measures))


def _given_up(total: Snapshot) -> Snapshot:
    """Count as given up what was in flight."""
    return total._replace(
        state=State.STARTING, reason='', measures=total.measures.at_rest,
        given_up=total.given_up + total.in_flight, in_flight=0,
    )  # fmt: skip


def _without_spooled(before: Snapshot) -> Snapshot:
    """Leave out what waits on disk: the next to open the file counts it as taken again."""
    waits = before.spooled or 0
    return before._replace(taken=before.taken - waits, spooled=None if waits else before.spooled)
