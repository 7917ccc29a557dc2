"""The bridge: one configuration, running. Start-up, run and shutdown in reading order."""

import logging
import os
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

from ros2_kafka_bridge.backoff import Backoff
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, warnings
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.logs import Repeated, route_log
from ros2_kafka_bridge.memory import give_back
from ros2_kafka_bridge.metrics import Counters, Snapshot, State
from ros2_kafka_bridge.plural import count
from ros2_kafka_bridge.ros.node import RosNode, middleware, open_node, worker_name
from ros2_kafka_bridge.ros.probe import Abilities, limits, probe, probe_topic
from ros2_kafka_bridge.status import totals
from ros2_kafka_bridge.status_log import StatusLog
from ros2_kafka_bridge.stop import Stop
from ros2_kafka_bridge.wiring import Direction, Route, Wiring, endpoints_of

_CLOSING_S = 10.0
_AT_ONCE_S = 2.0


def _tell_nobody() -> None:
    pass


class Bridge:
    """Runs the routes of a configuration, each in a thread of its own.

    Args:
        config: What to run.
        routes: Names of the routes to run; None runs all.
        worker: Number of this process among the workers of one bridge, from 1; 0 where it is the
            only one. A worker leaves to its supervisor what is said once for all of them.
    """

    def __init__(
        self, config: Config, routes: frozenset[str] | None = None, worker: int = 0
    ) -> None:
        self.config = _of_worker(config, worker)
        self.stop = Stop()
        self._worker = worker
        # Routes from ROS stop after those to ROS: what one of these has published last, and its
        # reader here has acknowledged, is still taken.
        self._stop_takers = Stop()
        self._lanes = [
            _Lane(route, self.stop if isinstance(route, KafkaToRosRoute) else self._stop_takers)
            for route in config.routes
            if routes is None or route.name in routes
        ]
        self._log = route_log()
        self._crashed = False

    def run(self, tell: Callable[[], None] = _tell_nobody) -> int:
        """Run until a stop is asked for; returns the exit status.

        Args:
            tell: Called by a route that has failed for good, before anything else happens: whoever
                restarts this process must know it. The snapshots say so by then.

        Raises:
            ConfigError: Nothing was started.
        """
        probed = probe_topic()
        routes = [lane.route for lane in self._lanes]
        endpoints = endpoints_of(routes, probed, self.config.ros.lease_s)
        name = worker_name(self.config.name, self._worker)
        with open_node(name, self.config.ros.domain_id, endpoints) as node:
            abilities = self._start(node, probed)
            give_back()
            wiring = Wiring(self.config, node, abilities, endpoints)
            for lane in self._lanes:
                lane.thread = threading.Thread(
                    target=self._keep_running,
                    args=(lane, wiring, tell),
                    name=lane.route.name,
                    daemon=True,
                )
                lane.thread.start()
            self._watch()
            self._shut_down()
        return 1 if self._crashed or any(lane.final for lane in self._lanes) else 0

    def snapshots(self) -> list[Snapshot]:
        """The counters of every route, each at one moment of its own."""
        return [lane.snapshot() for lane in self._lanes]

    # Start-up

    def _start(self, node: RosNode, probed: str) -> Abilities:
        abilities = probe(node, probed)
        if self._worker <= 1:
            for warning in (*warnings(self.config), *limits(abilities)):
                self._log.warning('%s', warning)
        worker = f', worker {self._worker},' if self._worker else ''
        self._log.info(
            'bridge %s%s runs %s on %s',
            self.config.name, worker, count(len(self._lanes), 'route'), middleware(),
        )  # fmt: skip
        return abilities

    # Run

    def _keep_running(self, lane: '_Lane', wiring: Wiring, tell: Callable[[], None]) -> None:
        """Run one route until a stop, again and again while it fails; in a thread of its own."""
        try:
            with ExitStack() as stack:
                while error := self._run_once(lane, wiring, stack):
                    lane.fail(error)
                    if lane.for_good:
                        tell()
                    lane.say_failure()
                    if lane.final:
                        break
                    lane.stop.wait(lane.backoff.wait_s)
        except BaseException:
            self._crashed = True
            lane.log.critical('a bug of the bridge ended this route', exc_info=True)
            if not self.stop.asked:
                self.stop.ask()

    def _run_once(self, lane: '_Lane', wiring: Wiring, stack: ExitStack) -> BridgeError | None:
        """Run one route until it stops or fails; returns why it has failed."""
        lane.begin()
        try:
            lane.direction = lane.direction or wiring.make(lane.route, lane.log, lane.stop, stack)
            lane.failure = ''
            if lane.direction is not None:
                lane.direction.run(lane.stop)
        except BridgeError as error:
            return error
        return None

    def _watch(self) -> None:
        status = StatusLog(self.snapshots)
        while not self.stop.asked and any(lane.runs for lane in self._lanes):
            if not self.stop.wait(0.2) and not self._worker:
                status.say()

    # Shutdown

    def _shut_down(self) -> None:
        """Drain the routes to ROS, then those from ROS; what does not end in time is left."""
        if not self._worker and any(lane.runs for lane in self._lanes):
            self._log.info('stopping: draining; once more stops at once')
        longest_s = max(lane.route.drain_s for lane in self._lanes)
        deadline_s = time.monotonic() + longest_s + _CLOSING_S
        self._join([lane for lane in self._lanes if lane.stop is self.stop], deadline_s)
        self._stop_takers.ask()
        self._join(self._lanes, deadline_s)
        for lane in self._lanes:
            lane.log.info('stopped: %s', totals(lane.snapshot()))
        if any(lane.runs for lane in self._lanes):
            self._log.error('some routes did not end in time and were left')
            logging.shutdown()
            os._exit(1)

    def _join(self, lanes: list['_Lane'], deadline_s: float) -> None:
        while any(lane.runs for lane in lanes) and time.monotonic() < deadline_s:
            if self.stop.at_once:
                self._stop_takers.ask()
                self._stop_takers.ask()
                deadline_s = min(deadline_s, time.monotonic() + _AT_ONCE_S)
            time.sleep(0.02)


class _Lane:
    """One route and what runs it."""

    def __init__(self, route: Route, stop: Stop) -> None:
        self.route = route
        self.stop = stop
        self.thread: threading.Thread | None = None
        self.log = route_log(route.name)
        self.direction: Direction | None = None
        self.failure = ''
        self.final = False
        self.for_good = False  # final, and not for the end of a drain
        self.backoff = Backoff()
        self._errors = Repeated(self.log)
        self._began_s = 0.0
        self._draining = False

    @property
    def runs(self) -> bool:
        return self.thread is not None and self.thread.is_alive()

    def begin(self) -> None:
        self._began_s = time.monotonic()
        self._draining = self.stop.asked  # a route that failed before still owes a drain

    def fail(self, error: BridgeError) -> None:
        """Note what has failed, and whether it is tried again."""
        self.backoff = self.backoff.after(time.monotonic() - self._began_s)
        for_good = isinstance(error, RouteError) and error.final
        self.for_good = for_good and not self.stop.asked
        self.failure = str(error)
        self.final = self._draining or for_good

    def say_failure(self) -> None:
        text = f'failed: {self.failure}'
        if self.final or self.stop.asked:
            self.log.error('%s', text)
        else:
            self._errors.error(text, f'; tried again in {self.backoff.wait_s:.0f} s')

    def snapshot(self) -> Snapshot:
        if self.direction is None:
            last = Counters(self.route.name).snapshot(0)
        else:
            last = self.direction.snapshot
        if self.failure:
            return last._replace(state=State.FAILED, reason=self.failure, final=self.for_good)
        return last


def _of_worker(config: Config, worker: int) -> Config:
    """Let the broker tell the workers apart, unless the user has named the clients."""
    if not worker:
        return config
    kafka = {'client.id': worker_name(config.name, worker), **config.kafka}
    return config.model_copy(update={'kafka': kafka})
