"""What is to be seen of a robot's battery: how far it is down, and whether it charges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ros2_kafka_warehouse.domain.signs import BATTERY

if TYPE_CHECKING:
    from collections.abc import Container

    from ros2_kafka_warehouse.domain.execution_profiles import Battery
    from ros2_kafka_warehouse.domain.signs import Signs
    from ros2_kafka_warehouse.messages.message import Cell
    from ros2_kafka_warehouse.messages.robots import RobotState

_BANDS: Final = ('', 'low', 'critical', 'empty')


def weigh_battery(charge: float, battery: Battery, needed: float, signs: Signs) -> None:
    """Show how far a battery is down, in percent; `needed` is what its task takes."""
    known = signs.evidence.get(BATTERY)
    # Who was empty stands: more than a little it has only from a person's hand.
    filled = known is not None and known.facts['band'] == 'empty' and charge >= battery.low
    if charge >= battery.target or filled:
        signs.clear(BATTERY)
    band = (
        'empty'
        if charge <= 0
        else 'critical'
        if charge < battery.critical
        else 'low'
        if charge < max(battery.low, needed)
        else ''
    )
    if band and (known is None or _BANDS.index(band) > _BANDS.index(str(known.facts['band']))):
        text = f'its battery is at {charge:.1f} %'
        if needed > charge:
            text += f', it needs {needed:.1f} %'
        signs.show(BATTERY, 'battery', text, band=band, state_of_charge=charge, needed=needed)


class ChargerWatch:
    """Counts the steps that a robot stands at a charger where it should charge, and does not."""

    __slots__ = ('_idle_steps',)

    def __init__(self) -> None:
        self._idle_steps = 0

    def look(
        self, state: RobotState, chargers: Container[Cell], gap: int, most_steps: int, signs: Signs
    ) -> None:
        """Show it once there are `most_steps`; `gap` of them have passed since the last look."""
        waits = (
            BATTERY in signs
            and not state.driving
            and not state.power_supply.charging
            and state.order_id.startswith('charge-')
            and state.cell in chargers
        )
        if not waits:
            self._idle_steps = 0
            signs.clear('not_charging')
            return
        self._idle_steps += gap
        if self._idle_steps >= most_steps and 'not_charging' not in signs:
            text = f'stands at the charger {state.last_node_id} and does not charge'
            steps = float(self._idle_steps)
            signs.show('not_charging', 'not_charging', text, steps=steps)
