"""A house with an exclusive route, and what tests put into it."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self, cast

from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import BridgeError, RouteError, SpoolInUseError
from ros2_kafka_bridge.protocol.worker import Event
from ros2_kafka_bridge.route.counters import Counters, Outcome, Snapshot
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.kafka.lock import GroupLock
    from ros2_kafka_bridge.wiring import Wiring

IN_USE = SpoolInUseError(4711, Path('/var/spool/pair.orders.spool.lock'))


class MemoryLock:
    """A lock in memory: `answers` says at each poll whose it is."""

    def __init__(self, answers: str = '') -> None:
        self.answers = answers.split()
        self.held = self.joined = self.wanted = False
        self.away = ''
        self.problems: list[BridgeError] = []
        self.said: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        if self.problems:
            raise self.problems.pop(0)

    def poll(self, timeout_s: float) -> None:
        assert timeout_s >= 0
        if self.answers:
            self.joined, self.held = True, self.answers.pop(0) == 'ours'

    def check(self) -> None:
        pass

    def has_standby(self) -> bool:
        return self.wanted

    def close(self) -> None:
        self.held = self.joined = False
        self.said.append('closed')


class MemoryPipeline:
    """A pipeline that takes some messages, does what it is told, and confirms all but some."""

    def __init__(self, taken: int, then: Callable[[Stop], None], left: int = 0) -> None:
        self.telling = SimpleNamespace(is_asked=False)
        self._counters = Counters('orders')
        self.snapshot = self._counters.snapshot(0)
        self._taken, self._then, self._left = taken, then, left

    def deliver_backlog(self, stop: Stop) -> None:
        self.run(stop)

    def run(self, stop: Stop, _pause: Pause | None = None) -> None:
        self._counters.taken += self._taken
        self._counters.end(Outcome.CONFIRMED, self._taken - self._left)
        self._counters.tell_end()
        self.snapshot = self._counters.snapshot(self._left)
        self._then(stop)


class Told:
    """A pipeline that shows a snapshot and does nothing."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.telling = SimpleNamespace(is_asked=False)
        self.snapshot = snapshot


class Nobody:
    """A successor where none is needed."""

    def note_readers(self, *, may_read: bool) -> None:
        pass

    def is_needed(self) -> bool:
        return False

    def has_come(self) -> bool:
        return False


class House:
    """A bridge with one route, whose terms are these pipelines, one after the other."""

    def __init__(self, lock: MemoryLock, *pipelines: MemoryPipeline) -> None:
        content = {
            'name': 'pair',
            'kafka': {'bootstrap.servers': 'localhost:1'},
            'routes': [
                {
                    'name': 'orders',
                    'from': {'ros': '/orders'},
                    'to': {'kafka': 'orders'},
                    'format': 'cdr',
                    'exclusive': True,
                    'drain_s': 0,
                }
            ],
        }
        self.bridge = Bridge(validated(Config, content))
        [self.runner] = self.bridge._runners
        assert self.bridge._locks.keys() == {'orders'}
        self.bridge._locks['orders'] = cast('GroupLock', lock)
        self.lock = lock
        self.pipelines = list(pipelines)
        self.for_backlog: MemoryPipeline | None = None
        self.in_use: SpoolInUseError | None = None
        self.claims_until_free = 0
        self.claims: list[int] = []  # ROS endpoints at each
        self.reasons: list[str] = []  # what the route said then
        self.open = 0  # ROS endpoints
        self.told = 0

    def make(self, *arguments: Any, **_named: Any) -> MemoryPipeline:
        self.open += 1
        arguments[3].callback(self._close)
        return self.pipelines.pop(0)

    def make_for_backlog(self, *_: Any) -> MemoryPipeline | None:
        return self.for_backlog

    def successor(self, _: Any) -> 'Nobody':
        return Nobody()

    def is_spool_in_use(self, _: Any) -> bool:
        return self.in_use is not None

    def claim_spool(self, _: Any) -> None:
        self.claims.append(self.open)
        self.reasons.append(self.snapshot.reason)
        if self.in_use is not None or len(self.claims) < self.claims_until_free:
            raise IN_USE

    def _close(self) -> None:
        self.open -= 1

    def run(self) -> None:
        self.bridge._keep_running(self.runner, cast('Wiring', self), self._tell)
        assert self.open == 0
        assert not self.bridge._crashed

    def _tell(self, _event: Event) -> None:
        self.told += 1

    def stop(self, _: Stop) -> None:
        self.runner.stop.ask()

    @property
    def snapshot(self) -> Snapshot:
        [snapshot] = self.bridge.snapshots()
        assert snapshot.balanced
        return snapshot


def turn(
    answers: str = '', *pipelines: MemoryPipeline, wanted: bool = False
) -> tuple[House, MemoryLock]:
    """A house, and its lock; another bridge stands by where it is `wanted`."""
    lock = MemoryLock(answers)
    lock.wanted = wanted
    return House(lock, *pipelines), lock


def until_asked(stop: Stop) -> None:
    assert stop.wait(10)


def fail(_: Stop) -> None:
    raise RouteError('no permission')
