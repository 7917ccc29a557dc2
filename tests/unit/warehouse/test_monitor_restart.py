"""A Monitor that was killed goes on with the same judgement."""

from typing import Any

import msgspec
import pytest
from support.warehouse.watched import Watched, block_ahead

from ros2_kafka_warehouse.messages.monitor import FailureEvent, OperatorCommand
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.robots import FleetState, PowerSupply, SafetyState


def _story(watched: Watched, restart_at: int) -> list[FailureEvent]:
    """Much goes wrong; the Monitor is killed at a step."""
    scenes: dict[int, Any] = {
        2: lambda: watched.say('motionFault'),
        4: lambda: watched.change('b', power_supply=PowerSupply(20.0)),
        6: lambda: watched.change('b', safety_state=SafetyState('MANUAL')),
        12: lambda: watched.operate('pause', ''),
        14: lambda: watched.operate('resume', ''),
        16: watched.say,
        20: lambda: watched.operate('rejoinRobot', 'a'),
        22: lambda: watched.absent.add('a'),
        30: lambda: watched.absent.discard('a'),
        40: lambda: watched.change('b', safety_state=SafetyState()),
        44: lambda: watched.operate('rejoinRobot', 'b'),
        50: lambda: watched.change('b', power_supply=PowerSupply(90.0)),
    }
    for step in range(60):
        if step in scenes:
            scenes[step]()
        if step == restart_at:
            watched.restart()
        watched.wait()
    return watched.events


@pytest.mark.parametrize('restart_at', [*range(1, 56, 3), 22, 23, 24, 25])
def test_a_monitor_that_is_killed_goes_on_with_the_same_judgement(restart_at: int) -> None:
    whole, killed = Watched(), Watched()
    expected = _story(whole, -1)
    events = _story(killed, restart_at)

    # What it had said just before may come again, and is known to be the same.
    assert list(dict.fromkeys(_plain(event) for event in events)) == [
        _plain(event) for event in expected
    ]
    assert killed.report.robots == whole.report.robots


def _plain(event: FailureEvent) -> bytes:
    """All of an event but its number, which counts instant actions, too."""
    return msgspec.json.encode(msgspec.structs.replace(event, sequence=0))


def test_a_monitor_that_starts_again_does_not_take_haulers_for_slow(watched: Watched) -> None:
    watched.change(robot_type='hauler', driving=True, node_states=('1,0',))
    watched.restart()
    watched.monitor.observe(FleetState(watched.step + 1, tuple(watched.states.values())), 1.0)
    watched.step += 1
    watched.change(last_node_id='1,0', driving=False, node_states=())

    assert watched.wait() == []


def test_cells_that_are_blocked_are_remembered_over_a_restart(watched: Watched) -> None:
    block_ahead(watched)
    watched.restart()
    watched.wait()

    assert [one.cell for one in watched.report.blocked] == [(1, 0)]
    watched.wait(130)
    assert watched.report.blocked == ()


def test_a_halt_is_remembered_over_a_restart(watched: Watched) -> None:
    watched.monitor.check(ValidatorReport(3, 3, (Violation(3, 'wall', 'a in a wall'),)))
    watched.wait()
    watched.restart()
    said = watched.wait(5)

    assert watched.report.halted == 'rule broken in step 3: a in a wall'
    assert [one for one in said if 'Detected' in one] in ([], ['FailureDetected VIOLATION'])
    assert len({event.failure_id for event in watched.events}) == 1


def test_a_command_counts_once_over_a_restart(watched: Watched) -> None:
    pause = OperatorCommand('1', 'pause')
    watched.monitor.operate(pause, 0)
    watched.monitor.operate(OperatorCommand('2', 'resume'), 0)
    watched.wait()
    watched.restart()
    watched.monitor.operate(pause, 0)
    watched.wait()

    assert watched.report.halted == ''
