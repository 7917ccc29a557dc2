"""What people do about failures, and how the Monitor has them decide."""

import msgspec
from support.warehouse.watched import SITE, Watched

from ros2_kafka_warehouse.codec import decode, encode
from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.domain.site import RobotPlace
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport, OperatorCommand
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.robots import ErrorLevel, SafetyState


def test_an_emergency_stop_that_is_released_in_time_costs_nothing(watched: Watched) -> None:
    watched.change(safety_state=SafetyState('MANUAL'))
    watched.wait(10)
    stood, kept = not watched.robot().can_move, watched.robot().keeps_task
    watched.change(safety_state=SafetyState())

    assert (stood, kept) == (True, True)
    assert watched.wait() == ['FailureResolved EMERGENCY_STOP']
    assert watched.robot().can_move


def test_an_emergency_stop_that_lasts_hands_the_tasks_over(watched: Watched) -> None:
    watched.change(safety_state=SafetyState('MANUAL'))
    watched.wait(22)

    assert not watched.robot().keeps_task
    assert not watched.robot().commissioned


def test_what_nobody_knows_stops_the_robot_and_calls_the_operator(watched: Watched) -> None:
    watched.say('gearboxSings', ErrorLevel.CRITICAL)

    assert [event.response for event in _after(watched) if event.event == 'ResponseOrdered'] == [
        'safe_stop', 'obstacle', 'reassign', 'out_of_service', 'call_operator',
    ]  # fmt: skip
    assert watched.robot().level is ErrorLevel.CRITICAL
    assert 'the operator is called' in watched.robot().answer


def _after(watched: Watched, steps: int = 1) -> list[FailureEvent]:
    before = len(watched.events)
    watched.wait(steps)
    return watched.events[before:]


def test_a_robot_that_does_not_pause_is_told_again_and_released_when_it_rejoins(
    watched: Watched,
) -> None:
    watched.say('gearboxSings')
    watched.wait(7)
    twice = watched.told()
    watched.change(paused=True)
    watched.wait(20)
    watched.say()
    watched.wait()
    watched.operate('rejoinRobot')
    watched.wait()

    assert twice == ['startPause', 'startPause']
    assert watched.told() == [*twice, 'stopPause']
    assert len({one.action_id for one in watched.actions}) == 3


def test_a_repaired_robot_gets_tasks_only_when_it_is_told_to_rejoin(watched: Watched) -> None:
    watched.say('motionFault')
    watched.wait()
    watched.say()
    watched.wait(100)
    repaired = watched.robot()
    watched.operate('rejoinRobot')
    watched.wait()

    assert not repaired.commissioned
    assert 'waits to be told to rejoin' in repaired.answer
    assert watched.robot().commissioned
    assert watched.robot().obstacle == ()


def test_a_repaired_robot_that_fails_again_before_it_rejoins_calls_the_operator_again(
    watched: Watched,
) -> None:
    watched.say('motionFault')
    watched.wait()
    watched.say()
    watched.wait(10)
    watched.say('motionFault')
    said = watched.wait()

    assert said[:2] == ['FailureDetected MOTION_FAULT', 'FailureDiagnosed MOTION_FAULT']
    assert watched.robot().answer == 'the operator is called'
    assert not watched.robot().commissioned


def test_a_robot_that_is_told_to_rejoin_just_before_its_repair_shows_rejoins(
    watched: Watched,
) -> None:
    watched.say('motionFault')
    watched.wait()
    watched.operate('rejoinRobot')
    watched.wait(3)
    watched.say()
    watched.wait(2)

    assert watched.robot().commissioned


def test_a_robot_that_still_fails_does_not_rejoin_and_says_why(watched: Watched) -> None:
    watched.say('motionFault')
    watched.wait()
    watched.operate('rejoinRobot')
    said = _after(watched, 22)
    watched.say()
    watched.wait()

    assert [event.outcome for event in said] == ['it cannot rejoin: reports motionFault (FATAL)']
    assert not watched.robot().commissioned


def test_a_robot_that_was_taken_away_is_missed_by_nobody_until_it_is_back(
    watched: Watched,
) -> None:
    watched.operate('removeRobot')
    watched.absent.add('a')
    said = watched.wait(60)
    gone = watched.robot()
    watched.operate('rejoinRobot')
    said += watched.wait(60)
    watched.absent.clear()
    watched.change(last_node_id='7,3')
    watched.wait(8)

    assert said == []
    assert (gone.commissioned, gone.keeps_task, gone.obstacle) == (False, False, ())
    assert gone.failure == 'REMOVED'
    assert watched.robot().commissioned
    assert watched.robot().state.last_node_id == '7,3'


def test_a_cell_that_the_operator_knows_to_be_blocked_stays_so_until_he_says(
    watched: Watched,
) -> None:
    watched.operate('blockCell', '', cell=(4, 2), known=True)
    watched.operate('blockCell', 'b', cell=(5, 2))
    watched.wait(400)

    assert [one.cell for one in watched.report.blocked] == [(4, 2)]


def test_all_stand_while_paused_and_go_on_after(watched: Watched) -> None:
    watched.operate('pause')
    watched.wait()
    halted = watched.report.halted
    for name in 'ab':
        watched.change(name, paused=True)
    watched.operate('resume')
    watched.wait()

    assert halted == 'paused by the operator'
    assert watched.report.halted == ''
    assert watched.told('b') == ['startPause', 'stopPause']


def test_a_command_counts_once(watched: Watched) -> None:
    pause = OperatorCommand('1', 'pause')
    watched.monitor.operate(pause, 0)
    watched.monitor.operate(OperatorCommand('2', 'resume'), 0)
    watched.monitor.operate(pause, 0)
    watched.wait()

    assert watched.report.halted == ''


def test_a_broken_rule_stops_all_until_it_is_acknowledged_and_resumed(watched: Watched) -> None:
    report = ValidatorReport(3, 3, (Violation(3, 'vertex', 'a and b at 1,1', ('a', 'b')),))
    watched.monitor.check(report)
    said = watched.wait()
    halted = [watched.report.halted]
    for command in ('resume', 'acknowledge', 'resume'):
        watched.step += 1
        watched.operate(command)
        watched.wait()
        halted.append(watched.report.halted)
    watched.monitor.check(decode(encode(report), ValidatorReport))
    watched.wait()

    assert said[0] == 'FailureDetected VIOLATION'
    assert [bool(one) for one in halted] == [True, True, True, False]
    assert 'a and b at 1,1' in halted[0]
    assert watched.events[-1].event == 'FailureResolved'
    assert watched.report.halted == ''


def test_another_broken_rule_stops_all_again(watched: Watched) -> None:
    first = Violation(3, 'vertex', 'a and b at 1,1', ('a', 'b'))
    watched.monitor.check(ValidatorReport(3, 3, (first,)))
    watched.wait()
    watched.operate('acknowledge')
    watched.operate('resume')
    watched.wait()
    second = Violation(9, 'wall', 'a in a wall', ('a',))
    watched.monitor.check(ValidatorReport(9, 9, (first, second)))
    watched.wait()

    assert watched.report.halted == 'rule broken in step 9: a in a wall'


def test_a_report_of_another_site_with_the_same_robots_is_not_believed(watched: Watched) -> None:
    report = decode(encode(watched.report), FleetReport)
    wider = msgspec.structs.replace(SITE, rows=('...........',) * 4)
    elsewhere = {**SITE.robots, 'a': RobotPlace('a', 'carrier', (5, 0))}

    assert Monitor(SITE).is_mine(report)
    assert not Monitor(wider).is_mine(report)
    assert not Monitor(msgspec.structs.replace(SITE, robots=elsewhere)).is_mine(report)
    watched.restart()
    watched.wait()
    assert Monitor(SITE).is_mine(watched.report)
