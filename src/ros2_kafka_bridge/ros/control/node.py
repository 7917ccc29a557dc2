"""The ROS node of a bridge: diagnostics, lifecycle, services and parameters.

It runs in the process that watches the bridge, and carries no message. What it is asked for it
asks of the supervisor, and what it shows is what the supervisor reports: a change from elsewhere
shows here a moment later.
"""

import json
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError, blamed
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Do, Report
from ros2_kafka_bridge.ros.arguments import ROS_ARGUMENTS
from ros2_kafka_bridge.ros.control.diagnostics import (
    BridgeIdentity,
    RecentCounters,
    Status,
    statuses,
)
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.installation import check_api
from ros2_kafka_bridge.ros.node import RosNode, node_name, open_made, told_by_others
from ros2_kafka_bridge.ros.rclpy_api import NeededBy
from ros2_kafka_bridge.ros.types import TypeLoader, WantedType
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from ros2_kafka_bridge.ros.control.lifecycle import ManagedNode

_TYPES: Final = ('diagnostic_msgs/msg/DiagnosticArray', 'lifecycle_msgs/msg/State')
_PERIOD_S: Final = 1.0
_LOOK_S: Final = 0.2
_AGAIN_S: Final = 30.0
_SETTLED_S: Final = 2.5
_NAMES_S: Final = 10.0
# One for each that may wait long: a transition, a pause, a reload, parameters; two for the rest.
_THREADS: Final = 6


class WatchedBridge(Protocol):
    """What is known of the bridge, and whom to ask for a change (`monitoring.state.Watch`).

    Each method may be called from any thread.
    """

    @property
    def config(self) -> Config:
        """The configuration that counts."""

    @property
    def configured(self) -> Configured:
        """Where it came from."""

    @property
    def routes(self) -> list[AnyRoute]:
        """The routes that this bridge runs."""

    @property
    def report_age_s(self) -> float:
        """How long ago the last report came."""

    def report(self) -> Report | None:
        """The last report."""

    def request(self, do: Do, route: str = '') -> Answer:
        """Ask the supervisor for something, and wait for what comes of it."""


def run_control(watch: WatchedBridge, stop: Stop) -> None:
    """Be in the ROS graph until a stop is asked for; tries again while ROS refuses.

    Args:
        watch: The bridge.
        stop: Asks for the end.
    """
    log, types = logs.route_log(), TypeLoader(RosSettings(packages='import'))
    said = ''
    while not stop.asked:
        problem = _until_problem(watch, stop, types, log)
        if problem and problem != said:
            log.error('the ROS node of the bridge cannot run, the routes go on: %s', problem)
        said = problem
        stop.wait(_AGAIN_S if problem else 0.0)


def _until_problem(watch: WatchedBridge, stop: Stop, types: TypeLoader, log: Log) -> str:
    try:
        if _import_packages(types, stop):
            _be_in_graph(watch, stop, log)
    except BridgeError as error:
        hint = ': build or install this ROS package, and source it'
        return f'{error}{hint if isinstance(error.__cause__, ImportError) else ""}'
    return ''


def _import_packages(types: TypeLoader, stop: Stop) -> bool:
    """Import the packages of others that the node needs; False at a stop.

    Raises:
        BridgeError: One cannot be imported, or its import has not ended.
    """
    if any(types.load(WantedType(name), stop) is None for name in _TYPES):
        return False
    with blamed('its ROS packages cannot be loaded'):
        check_api(NeededBy.MANAGED_NODE)
        import_module('ros2_kafka_bridge.ros.control.lifecycle')
        import_module('ros2_kafka_bridge.ros.control.services')
    return True


def _be_in_graph(watch: WatchedBridge, stop: Stop, log: Log) -> None:
    """Run the node until a stop, or until another name or domain counts."""
    place = _Place.of(watch.config)
    supervisor = SupervisorClient(watch)
    with ExitStack() as stack:
        node = stack.enter_context(_opened(place, supervisor, log))
        executor = stack.enter_context(_spinning(node))
        with translated('the ROS node of the bridge'):
            control = Control(watch, node, supervisor, log)
        next_s = time.monotonic()
        while not stop.asked and place == _Place.of(watch.config):
            if time.monotonic() >= next_s:
                next_s = max(next_s + _PERIOD_S, time.monotonic())
                with translated('the ROS node of the bridge'):
                    control.tick()
            _turn(executor, min(_LOOK_S, max(0.0, next_s - time.monotonic())), log)


class _Place(NamedTuple):
    """What a node has for its whole life."""

    name: str
    domain_id: int | None
    lease_s: float | None

    @classmethod
    def of(cls, config: Config) -> '_Place':
        return cls(config.name, config.ros.domain_id, config.ros.lease_s)


def _opened(place: _Place, supervisor: 'SupervisorClient', log: Log) -> Any:
    def make(context: Any) -> 'ManagedNode':
        from ros2_kafka_bridge.ros.control.lifecycle import ManagedNode  # noqa: PLC0415 (rclpy)

        return ManagedNode(
            node_name(place.name),
            supervisor.request,
            log,
            context=context,
            cli_args=_own_arguments(),
            use_global_arguments=False,
            enable_rosout=False,
        )

    return open_made(make, place.domain_id, Histories({}, {}, place.lease_s))


def _own_arguments() -> list[str]:
    """What `ros2 run` and launch gave: the name of the node, remappings."""
    given = os.environ.get(ROS_ARGUMENTS)
    return ['--ros-args', *json.loads(given)] if given else []


class SupervisorClient:
    """Asks the supervisor, and knows whether what it reports is newer than the last answer."""

    def __init__(self, watch: WatchedBridge) -> None:
        self._watch = watch
        self._lock = threading.Lock()
        self._waiting = 0
        self._ended_s = -_SETTLED_S

    def request(self, do: Do, route: str = '') -> Answer:
        """Ask for something, and wait for what comes of it; for any thread."""
        with self._lock:
            self._waiting += 1
        try:
            return self._watch.request(do, route)
        finally:
            with self._lock:
                self._waiting -= 1
                self._ended_s = time.monotonic()

    @property
    def settled(self) -> bool:
        """Whether the last report says what has come of everything that was asked for."""
        with self._lock:
            return not self._waiting and time.monotonic() - self._ended_s > _SETTLED_S


@contextmanager
def _spinning(node: RosNode) -> Iterator[Any]:
    """An executor, the only one of the bridge: nothing here is on the way of a message."""
    from rclpy.executors import MultiThreadedExecutor  # noqa: PLC0415 (rclpy)

    executor = MultiThreadedExecutor(_THREADS, context=node.context)
    executor.add_node(node.handle)
    try:
        yield executor
    finally:
        executor.remove_node(node.handle)
        executor.shutdown()


def _turn(executor: Any, timeout_s: float, log: Log) -> None:
    """Wait for a request, and let a thread of the executor answer it."""
    try:
        with translated('rclpy'):
            executor.spin_once(timeout_sec=timeout_s)
    except Exception as error:  # noqa: BLE001 (of rclpy, about what somebody else has sent)
        kind = '' if isinstance(error, BridgeError) else f'{type(error).__name__}: '
        text = f'a request to the ROS node of the bridge was not answered: {kind}{error}'
        logs.summed(log).warning(text)


class Control:
    """What the node shows and offers.

    Args:
        watch: The bridge.
        node: The node.
        supervisor: Asks for changes.
        log: Of the bridge.
    """

    def __init__(
        self, watch: WatchedBridge, node: RosNode, supervisor: SupervisorClient, log: Log
    ) -> None:
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415 (ROS)

        from ros2_kafka_bridge.ros.control.services import Offers  # noqa: PLC0415 (rclpy)

        self._watch = watch
        self._node = node.handle
        self._supervisor = supervisor
        self._log = log
        self._recent = RecentCounters()
        self._last: Report | None = None
        self._namesakes = Namesakes(node.handle, log)
        self._offers = Offers(node.handle, supervisor.request, log)
        self._publisher = node.handle.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def tick(self) -> None:
        """Say how the bridge is, and follow what was changed elsewhere."""
        report = self._watch.report()
        if report is not None and report is not self._last:
            self._recent.add(report, time.monotonic())
            self._last = report
        self._offers.offer(self._watch.config, self._watch.configured.file, self._watch.routes)
        if report is not None and self._supervisor.settled:
            self._node.follow(report.lifecycle)
            self._offers.follow(report.paused)
        self._publish(report)
        self._namesakes.look()

    def _publish(self, report: Report | None) -> None:
        bridge = BridgeIdentity(
            node=self._node.get_name(),
            file=self._watch.configured.file,
            version=__version__,
            routes=self._watch.routes,
        )
        told = statuses(bridge, report, self._watch.report_age_s, self._recent)
        hardware = self._watch.config.name
        self._publisher.publish(_message(told, hardware, self._node.get_clock().now().to_msg()))


def _message(told: Sequence[Status], hardware: str, stamp: Any) -> Any:
    from diagnostic_msgs.msg import (  # noqa: PLC0415 (ROS)
        DiagnosticArray,
        DiagnosticStatus,
        KeyValue,
    )

    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [
        DiagnosticStatus(
            level=bytes([status.level]),
            name=status.name,
            message=status.message,
            hardware_id=hardware,
            values=[KeyValue(key=key, value=value) for key, value in status.values],
        )
        for status in told
    ]
    return message


class Namesakes:
    """Warns of another node of the same name: services reach one of the two, nobody knows which.

    Args:
        node: The own one.
        log: Where it is said.
    """

    def __init__(self, node: Any, log: Log) -> None:
        self._node = node
        self._log = log
        self._next_s = time.monotonic()
        self._said = False

    def look(self) -> None:
        """Look at the graph, not too often."""
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _NAMES_S
        own = self._node.get_name(), self._node.get_namespace()
        try:
            with told_by_others('the nodes of the ROS graph'):
                there = self._node.get_node_names_and_namespaces().count(own)
        except BridgeError:
            return  # somebody has a name that cannot be read, or none
        if there > 1 and not self._said:
            self._log.warning(
                'another node is called %s, too: a service of that name may reach either bridge; '
                'leave that of one out (monitoring: {node: false}), or give it another name, by '
                '--ros-args -r __node:=NAME or, if they do not take turns, by name: in its file',
                self._node.get_fully_qualified_name(),
            )
        self._said = there > 1
