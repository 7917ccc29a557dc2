"""The bridge: one configuration, running. Start-up, run and shutdown in reading order."""

import logging
import os
import threading
import time
from contextlib import ExitStack

from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, warnings
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.logs import route_log
from ros2_kafka_bridge.memory import give_back
from ros2_kafka_bridge.metrics import Counters, Snapshot, State
from ros2_kafka_bridge.ros.node import RosNode, middleware, open_node
from ros2_kafka_bridge.ros.probe import Abilities, limits, probe, probe_topic
from ros2_kafka_bridge.status import status_line, totals
from ros2_kafka_bridge.stop import Stop
from ros2_kafka_bridge.wiring import Direction, Route, Wiring, endpoints_of

STATUS_S = 10.0
_FIRST_BACKOFF_S = 1.0
_LONGEST_BACKOFF_S = 10.0
_CLOSING_S = 10.0
_AT_ONCE_S = 2.0


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

    def run(self) -> int:
        """Run until a stop is asked for; returns the exit status.

        Raises:
            ConfigError: Nothing was started.
        """
        probed = probe_topic()
        routes = [lane.route for lane in self._lanes]
        endpoints = endpoints_of(routes, probed, self.config.ros.lease_s)
        name = f'{self.config.name}_{self._worker}' if self._worker else self.config.name
        with open_node(name, self.config.ros.domain_id, endpoints) as node:
            abilities = self._start(node, probed)
            give_back()
            wiring = Wiring(self.config, node, abilities, endpoints)
            for lane in self._lanes:
                lane.thread = threading.Thread(
                    target=self._keep_running,
                    args=(lane, wiring),
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
            'bridge %s%s runs %d routes on %s',
            self.config.name, worker, len(self._lanes), middleware(),
        )  # fmt: skip
        return abilities

    # Run

    def _keep_running(self, lane: '_Lane', wiring: Wiring) -> None:
        """Run one route until a stop, again and again while it fails; in a thread of its own."""
        try:
            with ExitStack() as stack:
                backoff_s = _FIRST_BACKOFF_S
                started_s = time.monotonic()
                while not self._run_once(lane, wiring, stack, backoff_s):
                    if time.monotonic() - started_s > _LONGEST_BACKOFF_S:
                        backoff_s = _FIRST_BACKOFF_S
                    lane.stop.wait(backoff_s)
                    backoff_s = min(_LONGEST_BACKOFF_S, 2 * backoff_s)
                    started_s = time.monotonic()
        except BaseException:
            self._crashed = True
            lane.log.critical('a bug of the bridge ended this route', exc_info=True)
            if not self.stop.asked:
                self.stop.ask()

    def _run_once(self, lane: '_Lane', wiring: Wiring, stack: ExitStack, backoff_s: float) -> bool:
        """Run one route until it stops or fails; tells whether that was the end of it."""
        draining = lane.stop.asked  # a route that failed before still owes a drain
        try:
            lane.direction = lane.direction or wiring.make(lane.route, lane.log, lane.stop, stack)
            lane.failure = ''
            if lane.direction is not None:
                lane.direction.run(lane.stop)
        except BridgeError as error:
            lane.failure = str(error)
            for_good = isinstance(error, RouteError) and error.final
            lane.final = draining or for_good
            lane.for_good = for_good and not lane.stop.asked
            again = '' if lane.final or lane.stop.asked else f'; tried again in {backoff_s:.0f} s'
            lane.log.error('failed: %s%s', error, again)  # noqa: TRY400 (the user's to mend)
            return lane.final
        return True

    def _watch(self) -> None:
        before = {s.route: s for s in self.snapshots()}
        looked_s = time.monotonic()
        while not self.stop.asked and any(lane.runs for lane in self._lanes):
            if self.stop.wait(0.2) or self._worker or time.monotonic() - looked_s < STATUS_S:
                continue
            period_s, looked_s = time.monotonic() - looked_s, time.monotonic()
            for lane in self._lanes:
                now = lane.snapshot()
                lane.log.info('%s', status_line(now, before[now.route], period_s))
                before[now.route] = now

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

    @property
    def runs(self) -> bool:
        return self.thread is not None and self.thread.is_alive()

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
    kafka = {'client.id': f'{config.name}-{worker}', **config.kafka}
    return config.model_copy(update={'kafka': kafka})
