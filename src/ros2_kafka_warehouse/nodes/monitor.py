"""Monitor: watches the robots, says what has failed, and orders what is to be done about it.

Its memory is its own newest report in Kafka: a Monitor that starts again goes on from there.
"""

import time
from threading import Event, Thread
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ros2_kafka_warehouse.codec import MessageError, decode
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.domain.robot_failure_profile import RobotFailureProfile
from ros2_kafka_warehouse.messages.monitor import FleetReport, OperatorCommand, RobotReport
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport
from ros2_kafka_warehouse.messages.robots import ErrorLevel, FleetOrders, FleetState
from ros2_kafka_warehouse.messages.tasks import Tasks
from ros2_kafka_warehouse.nodes.node import Gate, Module
from ros2_kafka_warehouse.nodes.standard import ros_name

_KAFKA_TOPIC: Final = 'warehouse.fleet'
_DIAGNOSTICS_S: Final = 1.0
_QUIET_S: Final = 0.2
_STALE: Final = frozenset(('COMM_LOST', 'ROBOT_LOST', 'SOFTWARE_CRASH'))


def start(module: Module) -> None:
    """Judge each state of the fleet, and its silence."""
    _Monitor(module)


class _Monitor:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._monitor = Monitor(module.site)
        self._remembers = self._has_begun = False
        self._memory: FleetReport | None = None
        self._judged_s = 0.0
        self._profiles = module.newest('/execution_profiles', ExecutionProfiles)
        self._failure_profile = module.newest('/robot_failure_profile', RobotFailureProfile)
        ready = Gate(lambda: self._has_begun)
        self._states = module.queue('/robots/state', FleetState)
        module.each('/tasks', Tasks, self._monitor.know, gate=ready, depth=1)
        module.each('/robots/orders', FleetOrders, self._monitor.expect, gate=ready)
        module.each('/operator/commands', OperatorCommand, self._operate, gate=ready)
        module.each('/validator/report', ValidatorReport, self._check, gate=ready, depth=1)
        self._report = module.speaker('/monitor/fleet')
        self._failures = module.speaker('/monitor/failures')
        self._actions = module.speaker('/robots/instant_actions')
        self._diagnostics = _Diagnostics(module)
        module.work_on(self._work, self._profiles, self._failure_profile)
        self._stopped = Event()
        thread = Thread(target=self._remember, name='memory', daemon=True)
        thread.start()
        module.at_end(self._stopped.set)

    # Memory

    def _remember(self) -> None:
        """Read the newest report of this site from Kafka; in a thread of its own."""
        servers = self._module.settings.bootstrap_servers
        if servers:
            from ros2_kafka_warehouse.kafka import newest  # noqa: PLC0415 (only where there is a Kafka)

            text = newest(servers, _KAFKA_TOPIC, self._module.log, self._stopped.is_set)
            self._memory = None if text is None else self._report_of(text)
        self._remembers = True
        self._module.ask()

    def _report_of(self, text: bytes) -> FleetReport | None:
        try:
            report = decode(text, FleetReport)
        except MessageError as error:
            self._module.log.warning('%s: %s', _KAFKA_TOPIC, error)
            return None
        if not self._monitor.is_mine(report):
            self._module.log.warning('%s is of another site: begins anew', _KAFKA_TOPIC)
            return None
        return report

    def _begin(self) -> None:
        """Say what is remembered: the robots wait for it."""
        if self._memory is not None and self._memory.robots:
            self._monitor.restore(self._memory)
            self._module.log.info('goes on from step %d', self._memory.step)
            self._report.say(self._memory)
        else:
            self._report.say(FleetReport(step=0))
        self._has_begun = True
        self._module.each_s(self._module.site.step_s, self._look)

    # Work

    def _work(self) -> None:
        if not self._remembers:
            return
        if not self._has_begun:
            self._begin()
        states = self._states.take()
        for state in states:
            self._monitor.observe(state, self._module.now_s())
        if states:
            self._judge()

    def _look(self) -> None:
        """Judge the silence, too."""
        if self._states.or_none is not None and (
            time.monotonic() > self._judged_s + self._module.site.step_s + _QUIET_S
        ):
            self._judge()

    def _judge(self) -> None:
        self._judged_s = time.monotonic()
        report, actions, events = self._monitor.judge(
            self._module.now_s(), self._profiles.value, self._failure_profile.value
        )
        self._report.say(report)
        if actions.actions:
            self._actions.say(actions)
        for event in events:
            self._failures.say(event)
        self._diagnostics.show(report)

    def _operate(self, command: OperatorCommand) -> None:
        now_s = self._module.now_s()
        what = (command.command, command.robot, command.failure)
        if command.is_old(now_s):
            self._module.log.warning('too late, is not done: %s %s %s', *what)
            return
        self._module.log.info('%s %s %s', *what)
        self._monitor.operate(command, now_s)

    def _check(self, report: ValidatorReport) -> None:
        self._monitor.check(report)


class _Diagnostics:
    """`/diagnostics`: a status for each robot, when it has changed, at most once a second."""

    def __init__(self, module: Module) -> None:
        self._publisher = module.ros_publisher('/diagnostics', DiagnosticArray)
        self._clock = module.node.get_clock()
        self._said: list[tuple[Any, ...]] | None = None
        self._next_s = 0.0

    def show(self, report: FleetReport) -> None:
        """Publish where somebody looks."""
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _DIAGNOSTICS_S
        if self._publisher.get_subscription_count() == 0:
            self._said = None
            return
        now = [(r.failure, r.level, r.answer, r.commissioned) for r in report.robots]
        if now == self._said:
            return
        self._said = now
        array = DiagnosticArray()
        array.header.stamp = self._clock.now().to_msg()
        array.status = [_status(robot) for robot in report.robots]
        self._publisher.publish(array)


def _status(robot: RobotReport) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=_level(robot),
        name=ros_name(robot.serial_number),
        message=robot.failure or 'OK',
        hardware_id=robot.serial_number,
        values=[
            KeyValue(key='answer', value=robot.answer),
            KeyValue(key='commissioned', value=str(robot.commissioned).lower()),
        ],
    )


def _level(robot: RobotReport) -> bytes:
    if robot.failure in _STALE:
        return bytes(DiagnosticStatus.STALE)
    if robot.level in (ErrorLevel.CRITICAL, ErrorLevel.FATAL):
        return bytes(DiagnosticStatus.ERROR)
    return bytes(DiagnosticStatus.WARN if robot.failure else DiagnosticStatus.OK)
