"""Detection: what is to be seen of a robot that should not be, without asking why.

A `Watch` follows one robot from state to state. It looks closely only at what has changed, and
keeps its signs: what stands as evidence now. What they mean is for the profile to say.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from ros2_kafka_warehouse.domain.battery_signs import ChargerWatch, weigh_battery
from ros2_kafka_warehouse.domain.complaints import (
    ALL_WELL,
    failed_actions,
    show_complaints,
    show_failed,
    show_overload,
    show_retriable,
)
from ros2_kafka_warehouse.domain.signs import BATTERY, CONTACT, NO_PROGRESS, SLOW, STUCK, Signs
from ros2_kafka_warehouse.messages.message import Cell, node_cell
from ros2_kafka_warehouse.messages.robots import ErrorLevel, RobotOrder, RobotState

if TYPE_CHECKING:
    from collections.abc import Container

    from ros2_kafka_warehouse.domain.execution_profiles import RobotType
    from ros2_kafka_warehouse.domain.robot_failure_profile import Limits

SLOW_FOR_S: Final = 20.0  # without moving a robot counts as slow no longer than this
ORDERS_KEPT: Final = 3  # a state may be seen some orders late

_HINDERS: Final = frozenset((ErrorLevel.CRITICAL, ErrorLevel.FATAL))

_FACTORS: Final = (1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0)


class Watch:
    """What is known of one robot, and what is to be seen of it.

    Attributes:
        order: The newest order for it, `ahead` the node that it may drive to by it.
        missing_s: Since when the fleet's states are without it; None: it is there.
        held: It has been told to stand: no progress is expected.
        needed: Percent of its battery that it needs for its task and the way to a charger.
        progress_s: When it last moved or acted.
    """

    __slots__ = (
        '_charger',
        '_counted',
        '_edge_steps',
        '_even_moves',
        '_failed',
        '_older',
        '_pending',
        '_slow_s',
        '_times_off_plan',
        'ahead',
        'has_task',
        'held',
        'hindered',
        'kind',
        'limits',
        'missing_s',
        'needed',
        'order',
        'progress_s',
        'seen_s',
        'signs',
        'state',
        'step',
        'still_steps',
    )

    def __init__(self, state: RobotState, step: int, now_s: float, limits: Limits) -> None:
        self.state = state
        self.step = step
        self.seen_s = now_s
        self.limits = limits
        self.signs = Signs()
        self.kind: RobotType | None = None
        self.order: RobotOrder | None = None
        self.ahead = ''
        self.missing_s: float | None = None
        self.held = False
        self.hindered = False
        self.has_task = False
        self.needed = 0.0
        self.progress_s = now_s
        self.still_steps = 0
        self._edge_steps = 0
        self._even_moves = 0
        self._charger = ChargerWatch()
        self._times_off_plan = 0
        self._older: deque[RobotOrder] = deque(maxlen=ORDERS_KEPT)
        self._slow_s = now_s
        self._counted: RobotOrder | None = None
        self._pending: tuple[str, int, str, float] | None = None
        self._failed = failed_actions(state)

    @property
    def carrying(self) -> bool:
        """Whether it has a load."""
        return bool(self.state.loads)

    def look(self) -> None:
        """Look at the whole of a state that is the first one."""
        self._conditions(self.state)
        show_retriable(self.state, self.signs)

    def know(self, kind: RobotType | None, limits: Limits) -> None:
        """Take in what its type can do, and what counts as evidence."""
        self.kind = kind
        self.limits = limits
        show_overload(self.state, kind, self.signs)
        charge = self.state.power_supply.state_of_charge
        if kind is not None and charge < kind.battery.low:
            weigh_battery(charge, kind.battery, self.needed, self.signs)

    def expect(self, order: RobotOrder | None) -> None:
        """Note what it is ordered to do; None: to stay. Who is not heard of gets no orders."""
        if self.missing_s is not None:
            return
        if order is None:
            self.ahead = ''
            return
        if self.order is not None:
            self._older.append(self.order)
        self.order = order
        nodes = order.nodes
        self.ahead = nodes[1].node_id if len(nodes) > 1 and nodes[1].released else ''
        if self._pending is not None:
            order_id, update, node, now_s = self._pending
            if order_id == order.order_id and update == order.order_update_id:
                self._pending = None
                self._compare_with(order, node, now_s)

    def see(self, state: RobotState, step: int, now_s: float, chargers: Container[Cell]) -> None:
        """Follow it to its next state."""
        last = self.state
        gap = 1 if step == self.step + 1 else 0
        self.state = state
        self.step = step
        self.seen_s = now_s
        if self.missing_s is not None:
            self._come_back(last, now_s)
            last, gap = state, 0
        if not gap:  # steps that were not seen say nothing of its pace
            self._edge_steps = 0
        if state is not last:
            self._compare(last, state, now_s, gap)
        if state.driving:
            self._drive(gap)
        elif self.ahead and not self.hindered:
            self._stand()
        battery = self.kind.battery if self.kind is not None else None
        if battery is not None:
            charge = state.power_supply.state_of_charge
            if charge < battery.low or charge < self.needed or BATTERY in self.signs.evidence:
                weigh_battery(charge, battery, self.needed, self.signs)
                if gap:
                    most = self.limits.not_charging_steps
                    self._charger.look(state, chargers, gap, most, self.signs)

    def miss(self, now_s: float) -> None:
        """Note that the fleet's newest state is without it."""
        if self.missing_s is None:
            self.missing_s = now_s
            self.forget_moves()

    def is_silent(self, now_s: float) -> None:
        """See whether it has been missing for too long."""
        if self.missing_s is None:
            return
        silent_s = now_s - self.missing_s
        if silent_s >= self.limits.silent_s and CONTACT not in self.signs:
            text = f'not heard of for {silent_s:.1f} s, last at {self.state.last_node_id}'
            self.signs.show(CONTACT, 'silent', text, silent_s=silent_s)

    def is_stuck(self, now_s: float) -> None:
        """See whether it has a task and has done nothing for it for too long."""
        if SLOW in self.signs and not self.held and now_s - self._slow_s >= SLOW_FOR_S:
            self.signs.clear(SLOW)  # it stands: its pace has to be seen anew
        if not self.has_task or self.hindered or BATTERY in self.signs:  # it may queue to charge
            self.progress_s = now_s
            self.signs.clear(STUCK)
            return
        idle_s = now_s - self.progress_s
        if idle_s >= self.limits.stuck_s and STUCK not in self.signs:
            text = f'has a task and has not moved for {idle_s:.0f} s'
            self.signs.show(STUCK, 'stuck', text, seconds=idle_s, carrying=self.carrying)

    def block(self) -> None:
        """Note that it does not drive where it may and nothing known stands in its way."""
        if NO_PROGRESS not in self.signs:
            text = f'has not begun to drive to {self.ahead} for {self.still_steps} steps'
            self.signs.show(
                NO_PROGRESS, 'no_progress', text, steps=self.still_steps, carrying=self.carrying
            )

    def hold(self, held: bool) -> None:  # noqa: FBT001  # a state, not an option
        """Note whether it has been told to stand; then it need not make progress."""
        self.held = held
        self._hinder()

    # What has changed

    def _come_back(self, last: RobotState, now_s: float) -> None:
        state, missing_s = self.state, self.missing_s
        assert missing_s is not None
        self.missing_s = None
        self.progress_s = now_s
        if state.header_id < last.header_id or (last.order_id and not state.order_id):
            absent_s = now_s - missing_s
            text = f'is back after {absent_s:.1f} s and has forgotten its order'
            until_s = now_s + self.limits.hold_s
            self.signs.show(CONTACT, 'restarted', text, until_s, absent_s=absent_s)
        else:
            self.signs.clear(CONTACT)
        self._conditions(state)

    def _compare(self, last: RobotState, state: RobotState, now_s: float, gap: int) -> None:
        if state.last_node_id != last.last_node_id:
            self._arrive(last, state, now_s, gap)
        elif state.driving and not last.driving and state.node_states:
            self._compare_with_order(state.node_states[0], now_s)
        if (
            state.errors != last.errors
            or state.safety_state != last.safety_state
            or state.position.localized != last.position.localized
            or state.loads != last.loads
            or state.paused != last.paused
            or state.operating_mode != last.operating_mode
        ):
            self._conditions(state)
        if state.action_states != last.action_states:
            self.progress_s = now_s
            self._actions(state, now_s)

    def _conditions(self, state: RobotState) -> None:
        show_complaints(state, self.kind, self.signs)
        self._hinder()

    def _hinder(self) -> None:
        """Whether something keeps it from driving, so that no progress says nothing new."""
        state = self.state
        self.hindered = (
            self.held
            or state.paused
            or state.safety_state != ALL_WELL
            or any(error.error_level in _HINDERS for error in state.errors)
        )
        if self.held:  # what it was told to stand for stays evidence until it may move again
            self.still_steps = self._edge_steps = self._even_moves = 0
        elif self.hindered:
            self.forget_moves()

    def forget_moves(self) -> None:
        """Take what was seen of its moves for over."""
        self.still_steps = self._edge_steps = self._even_moves = 0
        for key in (NO_PROGRESS, SLOW, STUCK):
            self.signs.clear(key)

    def _actions(self, state: RobotState, now_s: float) -> None:
        failed = failed_actions(state)
        new, self._failed = failed - self._failed, failed
        show_failed(state, new, now_s + self.limits.hold_s, self.signs)
        show_retriable(state, self.signs)

    # How it moves

    def _arrive(self, last: RobotState, state: RobotState, now_s: float, gap: int) -> None:
        self.progress_s = now_s
        self.still_steps = 0
        self.signs.clear(NO_PROGRESS)
        self.signs.clear(STUCK)
        if not (last.driving and state.last_node_id in last.node_states[:1]):
            self._compare_with_order(state.last_node_id, now_s)
        if gap == 0:
            return
        pace = self.kind.steps_per_cell if self.kind is not None else 1
        self._leaps(last, state, gap / pace, now_s)
        factor = (self._edge_steps + gap) / pace
        self._edge_steps = 0
        if self.hindered or self.kind is None:
            return
        if factor >= self.limits.slow_factor:
            self._even_moves = 0
            self._show_slow(factor)
        elif SLOW in self.signs:
            self._even_moves += 1
            if self._even_moves >= self.limits.even_moves:
                self.signs.clear(SLOW)

    def _drive(self, gap: int) -> None:
        self.still_steps = 0
        self._edge_steps += gap
        if self.hindered or self.kind is None:
            return
        # It has not arrived, so it takes one step more at least.
        factor = (self._edge_steps + 1) / self.kind.steps_per_cell
        if factor >= self.limits.slow_factor and gap:
            self._even_moves = 0
            self._show_slow(factor)

    def _show_slow(self, factor: float) -> None:
        known = self.signs.evidence.get(SLOW)
        self._slow_s = self.seen_s
        # Said anew only when it has become a good deal slower: each word is looked at.
        rounded = max((one for one in _FACTORS if one <= factor), default=factor)
        if known is None or rounded > float(known.facts['factor']):
            text = f'takes {factor:.1f} times as long for a cell as its type'
            self.signs.show(SLOW, 'slow', text, factor=rounded, carrying=self.carrying)

    def _stand(self) -> None:
        """Count the orders to drive on that it has taken and not begun."""
        order, state = self.order, self.state
        if (
            order is not None
            and order.order_update_id == state.order_update_id
            and order.order_id == state.order_id
            and order is not self._counted
            and order.nodes[0].node_id == state.last_node_id
        ):
            self._counted = order
            self.still_steps += 1

    def _leaps(self, last: RobotState, state: RobotState, cells: float, now_s: float) -> None:
        here, there = node_cell(last.last_node_id), node_cell(state.last_node_id)
        went = abs(here[0] - there[0]) + abs(here[1] - there[1])
        if went > cells + self.limits.jump_cells:
            text = (
                f'was at {last.last_node_id} and is at {state.last_node_id}: no robot is so fast'
            )
            until_s = now_s + self.limits.hold_s
            self.signs.show(
                'jump', 'jump', text, until_s, cells=float(went), carrying=self.carrying
            )

    def _compare_with_order(self, node: str, now_s: float) -> None:
        state = self.state
        for order in (self.order, *self._older):
            if (
                order is not None
                and order.order_update_id == state.order_update_id
                and order.order_id == state.order_id
            ):
                self._compare_with(order, node, now_s)
                return
        # The order may come later than the state that it has led to.
        self._pending = (state.order_id, state.order_update_id, node, now_s)

    def _compare_with(self, order: RobotOrder, node: str, now_s: float) -> None:
        if any(one.released and one.node_id == node for one in order.nodes):
            return
        self._times_off_plan += 1
        ordered = next((one.node_id for one in order.nodes[1:2] if one.released), 'no other cell')
        text = f'drives to {node}, was ordered to {ordered}'
        times = float(self._times_off_plan)
        until_s = now_s + self.limits.hold_s
        self.signs.show('off_plan', 'off_plan', text, until_s, times=times, carrying=self.carrying)
