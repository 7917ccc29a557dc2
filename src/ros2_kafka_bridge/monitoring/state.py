"""What is known of the bridge at this moment, for the threads of the process that watches it."""

import itertools
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Final

import msgspec

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, restored
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.monitoring.history import History
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Do, Report, Request, ToMonitor

_PATIENCE_S: Final = 60.0
_DRAINING: Final = frozenset({Do.RELOAD, Do.DEACTIVATE, Do.CLEANUP, Do.SHUTDOWN})


class Watch:
    """The `WatchedBridge`: its last report, its configuration, and what it has been asked for.

    Each method may be called from any thread.

    Args:
        write: Sends one line to the supervisor.
        patience_s: How long `request` waits for an answer, beside the longest drains.
    """

    def __init__(self, write: Callable[[bytes], None], patience_s: float = _PATIENCE_S) -> None:
        self.history = History()
        self._write = write
        self._patience_s = patience_s
        self._lock = threading.Lock()
        self._writing = threading.Lock()
        self._configured: tuple[Configured, Config] | None = None
        self._report: Report | None = None
        self._heard_s = time.monotonic()
        self._numbers = itertools.count(1)
        self._asked: dict[int, Future[Answer]] = {}
        self._ended = False

    def on_line(self, line: bytes) -> None:
        """Take a line of the supervisor.

        Raises:
            ValueError: It is none.
        """
        told = msgspec.json.decode(line, type=ToMonitor)
        if isinstance(told, Report):
            self.history.add(told, self._readers)
            with self._lock:
                self._report, self._heard_s = told, time.monotonic()
        elif isinstance(told, Answer):
            with self._lock:
                asked = self._asked.pop(told.number, None)
            if asked is not None:
                asked.set_result(told)
        else:
            config = restored(told.values)
            with self._lock:
                self._configured = told, config

    def report(self) -> Report | None:
        """The last one; None before the first."""
        return self._report

    @property
    def report_age_s(self) -> float:
        """How long ago the last report came, or this process began to wait for the first."""
        return time.monotonic() - self._heard_s

    @property
    def is_configured(self) -> bool:
        """Whether the configuration is known: it is the first that the supervisor tells."""
        return self._configured is not None

    @property
    def configured(self) -> Configured:
        """The values of the configuration that counts, and where they came from."""
        return self._known[0]

    @property
    def config(self) -> Config:
        """The configuration that counts."""
        return self._known[1]

    @property
    def routes(self) -> list[AnyRoute]:
        """The routes that this bridge runs, in the order of the file."""
        configured, config = self._known
        return [r for r in config.routes if not configured.routes or r.name in configured.routes]

    def close(self) -> None:
        """Note that the bridge has ended: nobody waits for an answer any more."""
        with self._lock:
            self._ended = True
            waiting, self._asked = self._asked, {}
        for number, asked in waiting.items():
            asked.set_result(_no_answer(number))

    def request(self, do: Do, route: str = '') -> Answer:
        """Ask the supervisor for something, and wait for what comes of it.

        Raises:
            ConfigError: The configuration is not known yet.
        """
        answer: Future[Answer] = Future()
        patience_s = self._patience_s + (_drains_s(self.config) if do in _DRAINING else 0.0)
        number = next(self._numbers)
        with self._lock:
            if self._ended:
                return _no_answer(number)
            self._asked[number] = answer
        try:
            with self._writing:
                self._write(msgspec.json.encode(Request(number, do, route)) + b'\n')
        except OSError:
            return _no_answer(number)
        try:
            return answer.result(patience_s)
        except TimeoutError:
            with self._lock:
                self._asked.pop(number, None)
            text = f'the bridge has not answered within {patience_s:g} s: look at its log'
            return Answer(number, done=False, text=text)

    @property
    def _readers(self) -> frozenset[str]:
        if not self.is_configured:
            return frozenset()
        return frozenset(route.name for route in self.config.to_ros)

    @property
    def _known(self) -> tuple[Configured, Config]:
        known = self._configured
        if known is None:
            raise ConfigError(['the bridge has not told its configuration yet'])
        return known


def _drains_s(config: Config) -> float:
    """The longest drain of the routes to ROS, and behind it that of those from ROS."""
    routes = config.to_ros, config.to_kafka
    return sum(max((route.drain_s for route in some), default=0.0) for some in routes)


def _no_answer(number: int) -> Answer:
    return Answer(number, done=False, text='the bridge has ended')
