"""A step of a simulation as a line of JSON: where the robots are, and what has happened."""

from collections.abc import Sequence

import msgspec

from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport
from ros2_kafka_warehouse.messages.orders import OrderEvent
from ros2_kafka_warehouse.messages.robots import FleetState, RobotState


def trace_line(
    state: FleetState,
    report: FleetReport,
    events: Sequence[OrderEvent],
    failures: Sequence[FailureEvent],
) -> bytes:
    """The line of a step, by its state and report, and by what was said in it."""
    line: dict[str, object] = {
        'step': state.step,
        'robots': [_trace(robot) for robot in state.states],
    }
    if gone := [one.serial_number for one in report.robots if one.is_off_the_floor]:
        line['removed'] = gone
    if events:
        line['events'] = events
    if failures:
        line['failures'] = failures
    return msgspec.json.encode(line)


def _trace(robot: RobotState) -> dict[str, object]:
    x, y = robot.cell
    trace: dict[str, object] = {
        'id': robot.serial_number,
        'x': x,
        'y': y,
        'load': robot.loads[0].load_id if robot.loads else None,
    }
    if robot.driving:
        trace['to'] = robot.cells[-1]
    return trace
