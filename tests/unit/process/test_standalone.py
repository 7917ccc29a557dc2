"""A bridge in one process does at once what a signal asks for, and looks at nothing for nobody."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest

from ros2_kafka_bridge.process.hangup import Signals
from ros2_kafka_bridge.process.standalone import Standalone
from ros2_kafka_bridge.protocol.worker import Begun
from ros2_kafka_bridge.route.counters import Counters, Snapshot
from ros2_kafka_bridge.threads.stop import SIGNALS, Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge
    from ros2_kafka_bridge.process.plan import Plan


class MemoryBridge:
    """A bridge that begins, and waits for a stop; notes how often it is asked how it is doing."""

    def __init__(self, for_s: float) -> None:
        self.stop = Stop()
        self.asked = 0
        self.was_stopped = False
        self._for_s = for_s

    def run(self, tell: Callable[[Any], None]) -> int:
        tell(Begun())
        self.was_stopped = self.stop.wait(self._for_s)
        return 0

    def snapshots(self) -> Sequence[Snapshot]:
        self.asked += 1
        return [Counters('orders').snapshot(0)]


class House:
    """A process with such a bridge."""

    def __init__(self, for_s: float) -> None:
        self.bridge = MemoryBridge(for_s)
        self.signals = Signals(lambda _: None)
        self.signals.had_terminal = False
        self.standalone = Standalone(
            cast('Bridge', self.bridge), cast('Plan', None), self.signals, 'text'
        )

    def run(self) -> float:
        """Run to the end; returns how long that took."""
        began_s = time.monotonic()
        self.signals.hear()
        assert self.standalone.run(lambda _: None) == 0
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
    look = signals.look

    def counted() -> None:
        looks.append(time.monotonic())
        look()

    monkeypatch.setattr(signals, 'look', counted)
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

    def reload() -> None:
        reloads.append(time.monotonic())
        house.bridge.stop.ask()

    monkeypatch.setattr(house.standalone, '_supervisor', reload)
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
    assert house.bridge.asked == 0
    assert len(looks) <= 3, 'once at the beginning, and once for what has been told'


def test_a_terminal_is_looked_at_while_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.process.hangup._has_terminal', lambda: True)
    house = House(1.2)
    house.signals.had_terminal = True
    looks = count_looks(house.signals, monkeypatch)
    house.run()
    assert 3 <= len(looks) <= 9
    assert house.bridge.asked == 0


def test_systemd_is_told_where_it_listens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / 'notify'))
        manager.settimeout(5)
        monkeypatch.setenv('NOTIFY_SOCKET', str(tmp_path / 'notify'))
        house = House(1.0)
        house.run()
        assert b'READY=1' in manager.recv(4096)
    assert 3 <= house.bridge.asked <= 9
