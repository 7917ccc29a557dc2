"""The bridge: one configuration, running. Start-up, run and shutdown in reading order."""

import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.settings import Config, warnings
from ros2_kafka_bridge.exclusive.leadership import Leadership
from ros2_kafka_bridge.exclusive.term import HANDOVER_S
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.logs.lines import RouteLog, route_log
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.outside.malloc import find_trim
from ros2_kafka_bridge.protocol.worker import Begun, Event, Loaded, RouteFailed, RoutesEnded
from ros2_kafka_bridge.ros.message_sizes import histories_of, message_sizes
from ros2_kafka_bridge.ros.node import RosNode, middleware, open_node, worker_name
from ros2_kafka_bridge.ros.probe import Abilities, limits, probe, probe_topic
from ros2_kafka_bridge.ros.type_support.choice import why_import
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.route.status import StatusLog, left, totals
from ros2_kafka_bridge.running.route_runner import RouteRunner
from ros2_kafka_bridge.threads.pause import Pause
from ros2_kafka_bridge.threads.stop import Part, Stop, ctrl_c_asks
from ros2_kafka_bridge.tracing.routes import open_tracing
from ros2_kafka_bridge.wiring import Wiring

_CLOSING_S = 10.0
_AT_ONCE_S = 2.0
_BEGIN_S = 0.02
_WATCH_S = 1.0

Tell = Callable[[Event], None]
"""Told of what happens, by the thread in which it does."""


def _tell_nobody(_event: Event) -> None:
    pass


class Bridge:
    """Runs the routes of a configuration, each in a thread of its own.

    Args:
        config: What to run.
        routes: Names of the routes to run; None runs all.
        worker: Number of this process among the workers of one bridge, from 1; 0 where it is the
            only one. A worker leaves to its supervisor what is said once for all of them.
        paused: Names of routes that begin paused.
    """

    def __init__(
        self,
        config: Config,
        routes: frozenset[str] | None = None,
        worker: int = 0,
        paused: frozenset[str] = frozenset(),
    ) -> None:
        self.config = _of_worker(config, worker)
        self.stop = Stop()
        self._worker = worker
        # Routes from ROS stop after those to ROS: what one of these has published last, and its
        # reader here has acknowledged, is still taken.
        self._stop_takers = Stop()
        stops = {
            Direction.KAFKA_TO_ROS: self.stop,
            Direction.ROS_TO_KAFKA: self._stop_takers,
        }
        self._runners = [
            RouteRunner(
                route,
                Part(stops[route.direction]),
                Pause(asked=route.name in paused),
            )
            for route in config.routes
            if routes is None or route.name in routes
        ]
        self._locks = {
            runner.route.name: self._make_lock(runner)
            for runner in self._runners
            if runner.route.exclusive
        }
        self._ending: set[str] = set()  # changed by single calls: two threads do
        self._may_begin = threading.Event()
        self._log = route_log()
        self._crashed = False

    def _make_lock(self, runner: RouteRunner) -> GroupLock:
        known = self.config
        return GroupLock(known.kafka, known.name, runner.route.name, runner.log, known.membership)

    def run(self, tell: Tell = _tell_nobody, *, waits: bool = False) -> int:
        """Run until a stop is asked for; returns the exit status.

        Whatever else ends it, as Ctrl-C in a program of one's own, goes on behind a drain.

        Args:
            tell: Told of a route that has failed for good before anything else happens: whoever
                restarts this process must know it. The snapshots say so by then.
            waits: Whether to load all and join the graph, and to wait for `begin` then.

        Raises:
            ConfigError: Nothing was started.
            TransportError: Nothing can be written.
        """
        probed = probe_topic()
        routes = [runner.route for runner in self._runners]
        name = worker_name(self.config.name, self._worker)
        sizes = message_sizes(self.config, routes, name, self.stop, self._log)
        histories = histories_of(routes, sizes, probed, self.config.ros.lease_s)
        with (
            open_node(name, self.config.ros.domain_id, histories) as node,
            open_tracing(self.config, self._worker, self._log) as tracing,
        ):
            abilities = self._start(node, probed)
            wiring = Wiring(self.config, node, abilities, histories, sizes, tracing)
            tell(Loaded())
            if waits and not self._wait_for_begin():
                return 0
            self._say_what_runs()
            with ctrl_c_asks(self.stop):
                try:
                    self._begin_routes(wiring, tell)
                    tell(Begun())
                    self._watch(tell)
                except BaseException:  # a bug, or the handler of a signal that raises something
                    if not self.stop.asked:
                        self.stop.ask()
                    raise
                finally:
                    self._shut_down()  # the routes need the node
        return 1 if self._crashed or any(runner.final for runner in self._runners) else 0

    def snapshots(self) -> list[Snapshot]:
        """The counters of every route, each at one moment of its own."""
        return [runner.snapshot() for runner in self._runners]

    def begin(self) -> None:
        """Let a bridge go on that waits for it."""
        self._may_begin.set()

    def end(self, routes: frozenset[str]) -> None:
        """Drain these routes and forget them; the others go on untouched.

        `RoutesEnded` is told of each. Any thread may call.
        """
        self._ending.update(routes)
        self.stop.wakeup.ring()
        for runner in self._runners:
            if runner.route.name in routes:
                runner.stop.ask()

    @property
    def runs(self) -> bool:
        """Whether a route of it runs."""
        return any(runner.runs for runner in self._runners)

    @property
    def paused(self) -> frozenset[str]:
        """Names of the routes that were asked to pause."""
        return frozenset(runner.route.name for runner in self._runners if runner.paused)

    def pause(self, route: str) -> bool:
        """Ask a route to take and publish nothing; what is in flight is confirmed.

        It stays a member of its group, and holds the publishers back that wait for it.

        Returns:
            Whether this bridge runs a route of that name.
        """
        return self._ask_to_pause(route, asked=True)

    def resume(self, route: str) -> bool:
        """Let a paused route go on; tells whether this bridge runs a route of that name."""
        return self._ask_to_pause(route, asked=False)

    def _ask_to_pause(self, route: str, *, asked: bool) -> bool:
        for runner in self._runners:
            if runner.route.name == route:
                runner.ask_to_pause(asked=asked)
                return True
        return False

    # Start-up

    def _start(self, node: RosNode, probed: str) -> Abilities:
        abilities = probe(node, probed)
        imported = self.config.ros.packages == 'as_needed' and why_import(self.stop)
        if self._worker <= 1:
            for warning in (*warnings(self.config), *limits(abilities)):
                self._log.warning('%s', warning)
            if imported:
                self._log.info('imports the packages of message types: %s', imported)
        return abilities

    def _wait_for_begin(self) -> bool:
        """Wait until the routes may begin; False where a stop comes first."""
        while not self._may_begin.wait(_BEGIN_S):
            if self.stop.asked:
                return False
        return True

    def _say_what_runs(self) -> None:
        worker = f', worker {self._worker},' if self._worker else ''
        self._log.info(
            'bridge %s%s runs %s on %s',
            self.config.name, worker, count(len(self._runners), 'route'), middleware(),
        )  # fmt: skip

    # Run

    def _begin_routes(self, wiring: Wiring, tell: Tell) -> None:
        for runner in self._runners:
            runner.thread = threading.Thread(
                target=self._keep_running,
                args=(runner, wiring, tell),
                name=runner.route.name,
                daemon=True,
            )
            runner.thread.start()

    def _keep_running(self, runner: RouteRunner, wiring: Wiring, tell: Tell) -> None:
        """Run one route until a stop; in a thread of its own."""
        runner.tell_final = partial(tell, RouteFailed())
        try:
            if (lock := self._locks.get(runner.route.name)) is not None:
                Leadership(lock, wiring).run(runner)
            else:
                make = partial(wiring.make, runner.route, runner.log, say=runner.wait_for_type)
                runner.run(runner.stop, make)
        except BaseException:
            self._crashed = True
            runner.log.critical('a bug of the bridge ended this route', exc_info=True)
            if not self.stop.asked:
                self.stop.ask()
        finally:
            self.stop.wakeup.ring()  # whoever watches looks which routes run

    def _watch(self, tell: Tell) -> None:
        status, trim = StatusLog(self.snapshots), find_trim()
        while not self.stop.asked and self.runs:
            self._forget_ended(tell)
            for log in self._logs():
                log.tick()
            trim()  # what a stall has filled is given back when it is over
            self.stop.wait_for_any(_BEGIN_S if self._ending else _WATCH_S)
            if not self._worker and not self.stop.asked:
                status.say()
        self._forget_ended(tell)

    def _logs(self) -> list[RouteLog]:
        return [self._log, *(runner.log for runner in self._runners)]

    def _forget_ended(self, tell: Tell) -> None:
        """Forget the routes that were to end and have."""
        ended = [x for x in self._runners if x.route.name in self._ending and not x.runs]
        if not ended:
            return
        self._runners = [runner for runner in self._runners if runner not in ended]
        self._ending.difference_update(runner.route.name for runner in ended)
        for runner in ended:
            runner.log.close()
            self._crashed = self._crashed or (runner.final and not runner.for_good)
            runner.log.info('stopped: %s', totals(runner.snapshot()))
        tell(RoutesEnded(tuple(runner.route.name for runner in ended)))

    # Shutdown

    def _shut_down(self) -> None:
        """Drain the routes to ROS, then those from ROS; what does not end in time is left."""
        if not self._worker and any(runner.runs for runner in self._runners):
            self._log.info('stopping: draining; once more stops at once')
        self._join(Direction.KAFKA_TO_ROS)
        self._stop_takers.ask()
        self._join(Direction.ROS_TO_KAFKA)
        for log in self._logs():
            log.close()
        late = [runner for runner in self._runners if runner.runs]
        for runner in self._runners:
            _say_end(runner, late=runner in late)
        if late:
            logging.shutdown()
            os._exit(1)

    def _join(self, direction: Direction) -> None:
        """Wait for the routes of one direction: what another has used up takes nothing from it."""
        runners = [runner for runner in self._runners if runner.route.direction is direction]
        longest_s = max((runner.route.drain_s for runner in runners), default=0.0)
        handover_s = HANDOVER_S if any(runner.route.exclusive for runner in runners) else 0.0
        deadline_s = time.monotonic() + longest_s + handover_s + _CLOSING_S
        while any(runner.runs for runner in runners) and time.monotonic() < deadline_s:
            if self.stop.at_once:
                self._stop_takers.ask()
                self._stop_takers.ask()
                deadline_s = min(deadline_s, time.monotonic() + _AT_ONCE_S)
            time.sleep(0.02)


def _say_end(runner: RouteRunner, *, late: bool) -> None:
    now = runner.snapshot()
    if late:
        held = left(now, runner.route.direction)
        runner.log.error('did not end in time: it is left with %s', held)
    else:
        runner.log.info('stopped: %s', totals(now))


def _of_worker(config: Config, worker: int) -> Config:
    """Let the broker tell the workers apart, unless the user has named the clients."""
    if not worker:
        return config
    kafka = {'client.id': worker_name(config.name, worker), **config.kafka}
    return replace(config, kafka=kafka)
