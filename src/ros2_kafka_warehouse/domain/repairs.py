"""A person who mends what has failed: for simulations, in which nobody else does."""

from random import Random
from typing import Final

from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport, OperatorCommand

SPREAD: Final = 0.5  # of the times of repair (lognormal): half of them are within a third
CALLS: Final = ('call_operator', 'out_of_service')
BACK_S: Final = 2.0  # from the repair until the robot is let in again


class Repairs:
    """Repairs each robot some time after its failure was detected, and lets it rejoin.

    Args:
        repair_s: Median of the time until a robot is repaired, in seconds.
        seed: Of the times.
    """

    def __init__(self, repair_s: float, seed: int = 0) -> None:
        self._repair_s = repair_s
        self._random = Random(seed)  # noqa: S311 - chance that can be repeated, no secret
        self._repairs: dict[str, float] = {}
        self._rejoins: dict[str, float] = {}
        self._number = 0

    def take(self, event: FailureEvent) -> None:
        """Hear of a failure."""
        called = event.event == 'ResponseOrdered' and event.response in CALLS
        if (event.event == 'FailureDetected' or called) and event.robot not in self._repairs:
            takes_s = self._repair_s * self._random.lognormvariate(0, SPREAD)
            self._repairs[event.robot] = event.time_s + takes_s

    def commands(self, report: FleetReport, now_s: float) -> list[OperatorCommand]:
        """What that person orders now."""
        commands = []
        for robot in [robot for robot, due_s in self._repairs.items() if due_s <= now_s]:
            del self._repairs[robot]
            if robot:
                commands.append(self._command('repairRobot', robot))
                self._rejoins[robot] = now_s + BACK_S
        due = [robot for robot, due_s in self._rejoins.items() if due_s <= now_s]
        if due:
            out = {robot.serial_number for robot in report.robots if not robot.commissioned}
            for robot in due:
                del self._rejoins[robot]
                if robot in out:
                    commands.append(self._command('rejoinRobot', robot))
        return commands

    def _command(self, command: str, robot: str) -> OperatorCommand:
        self._number += 1
        return OperatorCommand(f'operator-{self._number}', command, robot)
