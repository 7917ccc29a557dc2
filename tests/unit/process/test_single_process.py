"""A bridge in one process does at once what a signal asks for, and looks at nothing for nobody."""

import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.process.control_plane import ControlPlane
from ros2_kafka_bridge.process.plan import Plan, RoutePlan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.single_process import run_in_process
from ros2_kafka_bridge.protocol.worker import Begun
from ros2_kafka_bridge.route.counters import Counters, Snapshot, State
from ros2_kafka_bridge.threads.stop import SIGNALS, Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge

PLAN = Plan('x', {}, (RoutePlan('orders', Direction.KAFKA_TO_ROS, drain_s=8),))


class MemoryBridge:
    """A bridge that begins, and waits for a stop; notes how often it is asked how it is doing."""

    def __init__(self, for_s: float) -> None:
        self.stop = Stop()
        self.asked = 0
        self.was_stopped = False
        self.loads_s = self.drains_s = 0.0
        self._for_s = for_s
        self._state = State.STARTING

    def run(self, tell: Callable[[Any], None]) -> int:
        time.sleep(self.loads_s)
        self._state = State.RUNNING
        tell(Begun())
        self.was_stopped = self.stop.wait(self._for_s)
        time.sleep(self.drains_s)
        return 0

    def snapshots(self) -> Sequence[Snapshot]:
        self.asked += 1
        return [Counters('orders', state=self._state).snapshot(0)]


class House:
    """A process with such a bridge."""

    def __init__(self, for_s: float) -> None:
        self.bridge = MemoryBridge(for_s)
        self.signals = Signals(lambda _: None)
        self.signals.had_terminal = False

    def run(self) -> float:
        """Run to the end; returns how long that took."""
        began_s = time.monotonic()
        self.signals.install()
        bridge = cast('Bridge', self.bridge)
        assert run_in_process(bridge, PLAN, self.signals, 'text', lambda _: None) == 0
        return time.monotonic() - began_s


@pytest.fixture(autouse=True)
def _own_handlers() -> Iterator[None]:
    before = [signal.signal(number, signal.SIG_DFL) for number in SIGNALS]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.fixture(autouse=True)
def _nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('NOTIFY_SOCKET', raising=False)


def send_later(number: int) -> threading.Timer:
    timer = threading.Timer(0.3, os.kill, (os.getpid(), number))
    timer.start()
    return timer


def count_looks(signals: Signals, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    looks: list[float] = []
    look = signals.check_terminal

    def counted() -> None:
        looks.append(time.monotonic())
        look()

    monkeypatch.setattr(signals, 'check_terminal', counted)
    return looks


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_asks_for_a_stop_ends_the_process_at_once(number: int) -> None:
    house = House(20)
    late = send_later(number)
    assert house.run() < 5, 'the next look would be later'
    late.join()
    assert house.bridge.was_stopped


def test_a_signal_that_asks_for_a_reload_is_handled_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(20)
    reloads: list[float] = []

    def reload(_: ControlPlane) -> None:
        reloads.append(time.monotonic())
        house.bridge.stop.ask()

    monkeypatch.setattr(ControlPlane, 'enqueue_reload', reload)
    late = send_later(signal.SIGHUP)
    assert house.run() < 5
    late.join()
    assert len(reloads) == 1


def test_a_bridge_that_ends_by_itself_ends_the_process_at_once() -> None:
    assert House(0.2).run() < 5


def test_nothing_is_looked_at_where_nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    house = House(1.0)
    looks = count_looks(house.signals, monkeypatch)
    house.run()
    assert house.bridge.asked == 1, 'at its end'
    assert len(looks) <= 3, 'once at the beginning, and once for what has been told'


def test_a_terminal_is_looked_at_while_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.process.signals._has_terminal', lambda: True)
    house = House(1.2)
    house.signals.had_terminal = True
    looks = count_looks(house.signals, monkeypatch)
    house.run()
    assert 3 <= len(looks) <= 9
    assert house.bridge.asked == 1, 'at its end'


def test_systemd_is_told_where_it_listens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.settimeout(5)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        house = House(1.0)
        house.run()
        assert b'READY=1' in manager.recv(4096)
    assert 2 <= house.bridge.asked <= 5


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], list[str]]]:
    """What systemd has been told so far, but for signs of life."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.setblocking(False)  # noqa: FBT003 (the standard library's)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        found: list[str] = []

        def look() -> list[str]:
            with suppress(BlockingIOError):
                while True:
                    found.append(manager.recv(4096).decode())
            return found

        yield look


def test_systemd_is_told_that_the_routes_run_as_soon_as_they_do(
    told: Callable[[], list[str]],
) -> None:
    house = House(0.8)
    house.bridge.loads_s = 0.5
    house.run()
    assert told()[0] == 'READY=1\nSTATUS=active: 1 route'


def test_systemd_is_told_when_a_bridge_stops_by_itself_and_not_when_it_has_ended(
    told: Callable[[], list[str]],
) -> None:
    """As after a bug in a route; and its drain is not cut short by that."""
    house = House(20)
    house.bridge.drains_s = 1.0
    seen: list[tuple[bool, bool]] = []

    def look() -> None:
        seen.append(('STOPPING=1\nSTATUS=draining' in told(), house.bridge.stop.at_once))

    timers = [threading.Timer(0.5, house.bridge.stop.ask), threading.Timer(1.0, look)]
    for timer in timers:
        timer.start()
    house.run()
    for timer in timers:
        timer.join()
    assert seen == [(True, False)]


def test_a_bridge_that_takes_long_to_close_is_not_said_to_be_killed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It has limits of its own: to give it up, or to kill it, would end all."""
    monkeypatch.setattr('ros2_kafka_bridge.process.draining._AT_ONCE_S', 0.1)
    house = House(20)
    house.bridge.drains_s = 1.5
    late = [send_later(signal.SIGTERM), send_later(signal.SIGTERM)]
    house.run()
    for timer in late:
        timer.join()
    assert 'killed' not in caplog.text


def test_a_stop_while_the_bridge_loads_is_said_by_the_bridge_alone(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, 'ros2_kafka_bridge')
    house = House(20)
    house.bridge.loads_s = 0.8
    late = send_later(signal.SIGTERM)
    house.run()
    late.join()
    assert 'stopping: draining' not in caplog.text
