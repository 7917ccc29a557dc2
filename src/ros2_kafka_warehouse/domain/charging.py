"""Who charges where: robots that need it before those that are idle, the nearest charger each."""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.grid import Distances
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport

NEAR_TARGET: Final = 5.0  # percent below the target at which an idle robot needs no charger


def give_chargers(
    report: FleetReport,
    busy: AbstractSet[str],
    profiles: ExecutionProfiles,
    chargers: Sequence[Cell],
    distances: Distances,
    before: Mapping[str, Cell],
    *,
    is_work: bool,
) -> dict[str, Cell]:
    """The charger of each robot that is to charge now.

    Robots that find no free charger get none, and wait.

    Args:
        report: The robots as the Monitor sees them.
        busy: Robots that carry a load.
        profiles: With the batteries of the types.
        chargers: All chargers of the site.
        distances: Of the floor as it is now.
        before: The answer of the last time: who has a charger keeps it while it is needed.
        is_work: Whether tasks wait, so that nobody charges who need not.
    """
    free = [
        cell
        for cell in chargers
        if cell not in report.faulty_chargers and cell not in distances.blocked
    ]
    needy = [robot for robot in report.robots if _needs(robot, busy)]
    idle = [] if is_work else [robot for robot in report.robots if _may(robot, busy, profiles)]
    given: dict[str, Cell] = {}
    for robots in (needy, idle):
        kept = {
            robot.serial_number: before[robot.serial_number]
            for robot in robots
            if before.get(robot.serial_number) in free
        }
        given |= kept
        free = [cell for cell in free if cell not in kept.values()]
        others = [robot for robot in robots if robot.serial_number not in given]
        nearest = _nearest(others, free, distances)
        given |= nearest
        free = [cell for cell in free if cell not in nearest.values()]
    return given


def _needs(robot: RobotReport, busy: AbstractSet[str]) -> bool:
    if not robot.can_move or not robot.charge:
        return False
    return robot.charge == 'now' or robot.serial_number not in busy


def _may(robot: RobotReport, busy: AbstractSet[str], profiles: ExecutionProfiles) -> bool:
    """Whether an idle robot uses the time: until it is full, once it has begun."""
    kind = profiles.robot_types.get(robot.state.robot_type)
    if kind is None or robot.charge or not (robot.can_move and robot.commissioned):
        return False
    power = robot.state.power_supply
    enough = kind.battery.target if power.charging else kind.battery.target - NEAR_TARGET
    return robot.serial_number not in busy and power.state_of_charge < enough


def _nearest(
    robots: Sequence[RobotReport], chargers: Sequence[Cell], distances: Distances
) -> dict[str, Cell]:
    if not robots or not chargers:
        return {}
    steps = distances.between([robot.state.cells[-1] for robot in robots], chargers)
    reachable = np.isfinite(steps)
    rows, columns = linear_sum_assignment(np.where(reachable, steps, 1e9))
    return {
        robots[row].serial_number: chargers[column]
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
        if reachable[row, column]
    }
