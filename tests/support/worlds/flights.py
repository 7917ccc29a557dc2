"""A pipeline with ends in memory: driven step by step, and what must be true of it each time."""

from collections import Counter
from typing import Any

import pytest

from ros2_kafka_bridge import kafka_to_ros, ros_to_kafka
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.route.counters import Outcome, Snapshot
from ros2_kafka_bridge.route.flight.flight import Entry, Flight
from ros2_kafka_bridge.route.flight.stage import HELD, READY, STEPS, STORED, Stage
from ros2_kafka_bridge.spool import spooling
from ros2_kafka_bridge.threads.stop import Stop

_STRING = 'std_msgs/msg/String'
TO_ROS: dict[str, Any] = {
    'from': {'kafka': 'orders'}, 'to': {'ros': '/orders', 'type': _STRING}, 'format': 'text',
}  # fmt: skip
TO_KAFKA: dict[str, Any] = {
    'from': {'ros': '/orders', 'type': _STRING}, 'to': {'kafka': 'orders'}, 'format': 'text',
}  # fmt: skip


class Driven:
    """What a house of either way is: a pipeline that a test drives.

    `give` puts into its source what waits there.
    """

    pipeline: Any
    give: Any
    usual = 4

    def steps(self, count: int | None = None) -> None:
        for _ in range(self.usual if count is None else count):
            self.pipeline._step()
            self.check_balance()

    def take(self, *given: Any, steps: int | None = None, **more: Any) -> None:
        """Give something, and let the pipeline go on."""
        self.give(*given, **more)
        self.steps(steps)

    def rests(self, count: int = 3) -> None:
        for _ in range(count):
            self.pipeline._rest()
            self.check_balance()

    def begin(self) -> None:
        """Begin a run, that `fail_and_run_again` may end."""
        self._opened = self.pipeline._opened()
        self._opened.__enter__()

    def fail_and_run_again(self) -> None:
        """Let the run end with an error, and begin the next."""
        error = RouteError('no permission')
        assert not self._opened.__exit__(RouteError, error, None)
        self.begin()

    def shown(self) -> Snapshot:
        """What it tells of itself now."""
        self.pipeline._show('')
        snapshot: Snapshot = self.pipeline.snapshot
        return snapshot

    def stop(self) -> None:
        """Let it run where a stop is asked for already: it drains."""
        stop = Stop()
        stop.ask()
        self.pipeline.run(stop)

    def check_balance(self) -> None:
        snapshot = self.pipeline.counters.snapshot(len(self.pipeline._flight))
        assert snapshot.balanced, snapshot
        check(self.pipeline._flight)


def check(flight: Flight[Any]) -> None:
    """Each entry is counted, has not ended, and waits in its lane where it is ready."""
    held = [*flight]
    ended = flight._ended
    assert len({*held}) == len(held)
    assert all(entry.outcome is None and entry.stage is not STORED for entry in held)
    assert all(entry.outcome is not None for entry in ended)
    assert len(flight) == len(held) + len(ended)
    assert flight.size_bytes == sum(entry.size_bytes for entry in held)
    letters = [entry for entry in held if entry.lane is flight.letters]
    assert flight.letter_bytes == sum(entry.size_bytes for entry in letters)
    for lane in (flight.lane, flight.letters):
        assert Counter(lane.ready) == Counter(
            entry for entry in held if entry.stage is READY and entry.lane is lane
        )
    for ring in flight._rings.values():
        entries = [*ring]
        assert [ring, *entries] == [entry.previous for entry in [*entries, ring]]


def check_steps(patch: pytest.MonkeyPatch) -> None:
    """Let every entry from now on fail where its stage makes a step that is not in the table."""
    for module, name in (
        (kafka_to_ros, 'RecordEntry'),
        (ros_to_kafka, 'MessageEntry'),
        (spooling, 'MessageEntry'),
    ):
        patch.setattr(module, name, _checked(getattr(module, name)))


def _checked(kind: type[Any]) -> type[Entry]:
    class CheckedEntry(kind):  # type: ignore[misc]
        __slots__ = ()

        def __setattr__(self, name: str, value: object) -> None:
            if name == 'stage':
                assert may_follow(getattr(self, 'stage', None), value)
            super().__setattr__(name, value)

    return CheckedEntry


def may_follow(before: object, after: object) -> bool:
    """Whether a stage or an outcome may come behind another."""
    if not isinstance(before, Stage):
        return before is None and after is HELD
    if isinstance(after, Outcome):
        return before is not STORED
    return after is before or after in STEPS[before]
