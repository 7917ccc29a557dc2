"""Robots: the simulated fleet, which drives a step at a time and says what it has become.

A fleet of real robots takes the place of this module: whatever hears `/robots/orders` and says
`/robots/state`.
"""

from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.faults import FaultPlan, read_fault
from ros2_kafka_warehouse.domain.robots import Fleet
from ros2_kafka_warehouse.messages.monitor import FleetReport, OperatorCommand
from ros2_kafka_warehouse.messages.robots import (
    FleetOrders,
    FleetState,
    InstantActions,
    RobotState,
)
from ros2_kafka_warehouse.nodes.node import Gate, Module
from ros2_kafka_warehouse.nodes.standard import FRAME, place, ros_name

_PERCENT: Final = 100.0
_HOUR_S: Final = 3600.0


def start(module: Module) -> None:
    """Drive, once the Monitor has said where the robots were seen last."""
    _Robots(module)


class _Robots:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._fleet: Fleet | None = None
        self._profiles = module.newest('/execution_profiles', ExecutionProfiles)
        self._report = module.newest('/monitor/fleet', FleetReport)
        # What comes before the fleet is there waits in DDS.
        ready = Gate(lambda: self._fleet is not None)
        module.each('/robots/orders', FleetOrders, self._order, gate=ready)
        module.each('/robots/instant_actions', InstantActions, self._act, gate=ready)
        module.each('/operator/commands', OperatorCommand, self._operate, gate=ready)
        self._state = module.speaker('/robots/state')
        self._looks = _Looks(module)
        module.work_on(self._begin, self._profiles, self._report)

    def _begin(self) -> None:
        """Put the robots where the Monitor has seen them last, or at home if it has not."""
        if self._fleet is not None:
            return
        module, report = self._module, self._report.value
        self._fleet = Fleet(
            module.site, self._profiles.value, module.settings.seed, _faults(module)
        )
        if report.robots:
            self._fleet.restore(report)
            module.log.info('the robots go on from step %d', report.step)
        module.each_s(module.site.step_s, self._step)

    def _step(self) -> None:
        assert self._fleet is not None
        state = self._fleet.step()
        self._state.say(state)
        self._looks.show(state)

    def _order(self, orders: FleetOrders) -> None:
        assert self._fleet is not None
        self._fleet.order(orders)

    def _act(self, actions: InstantActions) -> None:
        assert self._fleet is not None
        self._fleet.act(actions)

    def _operate(self, command: OperatorCommand) -> None:
        assert self._fleet is not None
        if command.is_old(self._module.now_s()):
            self._module.log.warning('too late, is not done: %s', command.command)
            return
        self._fleet.operate(command)


def _faults(module: Module) -> FaultPlan:
    """Faults by chance, as many as are asked for, and those with a step of their own."""
    settings, names = module.settings, module.site.robots
    schedule = tuple(read_fault(text, names) for text in settings.faults)
    per_hour = settings.failures_per_hour
    mean_s = len(names) * _HOUR_S / per_hour if per_hour > 0 else 0.0
    return FaultPlan(mean_s / module.site.step_s, schedule)


class _Looks:
    """`/<robot>/pose` and `/<robot>/battery_state` for those who look on."""

    def __init__(self, module: Module) -> None:
        self._clock = module.node.get_clock()
        names = module.site.robots
        self._poses: dict[str, Any] = {
            name: module.ros_publisher(f'/{ros_name(name)}/pose', PoseStamped) for name in names
        }
        self._batteries: dict[str, Any] = {
            name: module.ros_publisher(f'/{ros_name(name)}/battery_state', BatteryState)
            for name in names
        }

    def show(self, fleet: FleetState) -> None:
        """Publish where somebody looks."""
        for state in fleet.states:
            name = state.serial_number
            if self._poses[name].get_subscription_count():
                self._poses[name].publish(self._pose(state))
            if self._batteries[name].get_subscription_count():
                self._batteries[name].publish(self._battery(state))

    def _pose(self, state: RobotState) -> PoseStamped:
        pose = PoseStamped()
        pose.header.frame_id = FRAME
        pose.header.stamp = self._clock.now().to_msg()
        place(pose.pose, state.position.x, state.position.y, state.position.theta)
        return pose

    def _battery(self, state: RobotState) -> BatteryState:
        battery = BatteryState()
        battery.header.frame_id = ros_name(state.serial_number)
        battery.header.stamp = self._clock.now().to_msg()
        battery.percentage = state.power_supply.state_of_charge / _PERCENT
        battery.power_supply_status = (
            BatteryState.POWER_SUPPLY_STATUS_CHARGING
            if state.power_supply.charging
            else BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        )
        battery.present = True
        return battery
