"""What the Monitor sees of batteries, loads and actions, and who gets the tasks."""

import msgspec
from support.warehouse.watched import CHARGER, SITE, Watched, a_task

from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.messages.message import node_id
from ros2_kafka_warehouse.messages.robots import (
    ActionState,
    ActionStatus,
    Error,
    ErrorLevel,
    Load,
    PowerSupply,
)
from ros2_kafka_warehouse.messages.tasks import Tasks, TaskStatus


def test_a_low_battery_is_charged_soon_and_a_critical_one_at_once(watched: Watched) -> None:
    watched.change(power_supply=PowerSupply(20.0))
    low = watched.wait()
    soon = watched.robot().charge
    watched.change(power_supply=PowerSupply(5.0))
    critical = watched.wait()
    now = watched.robot().charge
    watched.change(power_supply=PowerSupply(50.0, charging=True))
    half = watched.wait()
    watched.change(power_supply=PowerSupply(85.0, charging=True))

    assert (low[1], soon) == ('FailureDiagnosed LOW_BATTERY', 'soon')
    assert (critical[0], now) == ('FailureEscalated BATTERY_CRITICAL', 'now')
    assert half == []
    assert watched.wait() == ['FailureResolved BATTERY_CRITICAL']
    assert watched.robot().charge == ''
    assert len({event.failure_id for event in watched.events}) == 1


def test_a_charger_that_does_not_charge_is_not_used_for_a_while(watched: Watched) -> None:
    watched.change(
        power_supply=PowerSupply(20.0), last_node_id=node_id(CHARGER), order_id='charge-a'
    )
    said = watched.wait(6)
    faulty = watched.report.faulty_chargers
    watched.change(last_node_id='5,3')
    watched.wait(650)

    assert 'FailureDiagnosed CHARGER_FAULT' in said
    assert faulty == (CHARGER,)
    assert watched.report.faulty_chargers == ()


def test_a_pick_that_waits_for_a_retry_is_tried_again_and_then_given_up(watched: Watched) -> None:
    pick = ActionState('o/1#0:pick', 'pick', ActionStatus.RETRIABLE, 'slipped')
    watched.change(action_states=(pick,))
    watched.wait(16)
    cancelled = msgspec.structs.replace(pick, action_status=ActionStatus.FAILED)
    watched.change(action_states=(cancelled,))

    assert watched.told() == ['retry', 'retry', 'cancelOrder']
    assert watched.wait(8)[-1] == 'FailureResolved PICK_FAILED'
    assert watched.robot().can_move


def test_a_retry_that_works_ends_the_failure(watched: Watched) -> None:
    pick = ActionState('o/1#0:pick', 'pick', ActionStatus.RETRIABLE)
    watched.change(action_states=(pick,))
    watched.wait()
    running = msgspec.structs.replace(pick, action_status=ActionStatus.RUNNING)
    watched.change(action_states=(running,))
    while_running = watched.wait()
    done = msgspec.structs.replace(pick, action_status=ActionStatus.FINISHED)
    watched.change(action_states=(done,))

    assert while_running == []
    assert watched.wait() == ['FailureResolved PICK_FAILED']


def test_an_action_that_failed_before_the_monitor_came_is_not_its_business() -> None:
    watched = Watched()
    failed = ActionState('o/1#0:pick', 'pick', ActionStatus.FAILED, 'LOAD_MISSING')
    watched.change(action_states=(failed,))
    watched.monitor = Monitor(SITE)

    assert watched.wait(3) == []


def test_the_error_and_the_failed_action_are_one_failure(watched: Watched) -> None:
    failed = ActionState('o/1#0:pick', 'pick', ActionStatus.FAILED, 'LOAD_MISSING')
    watched.change(action_states=(failed,), errors=(Error('loadMissing', ErrorLevel.CRITICAL),))
    watched.wait()

    assert {event.code for event in watched.events} == {'LOAD_MISSING'}
    assert len({event.failure_id for event in watched.events}) == 1


def test_a_load_above_what_the_type_carries_stops_nobody_from_being_told(watched: Watched) -> None:
    watched.change(loads=(Load('o/1', 'anvil', 99.0),))

    assert 'FailureDiagnosed OVERWEIGHT' in watched.wait()
    assert watched.events[0].evidence == 'carries 99 kg, more than 30 kg'


def test_the_time_to_the_robot_that_takes_over_can_be_seen_from_events(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (a_task(),)))
    watched.change(loads=(Load('o/1'),))
    watched.wait()
    watched.say('motionFault')
    watched.wait()
    kept = watched.robot().keeps_task
    watched.monitor.know(Tasks(2, (a_task(robot='', status=TaskStatus.OPEN),)))
    watched.wait(3)
    watched.monitor.know(Tasks(3, (a_task(robot='b', status=TaskStatus.ASSIGNED),)))
    watched.wait()
    detected, reassigned = (
        next(event for event in watched.events if event.event == name)
        for name in ('FailureDetected', 'TaskReassigned')
    )

    assert not kept
    assert reassigned.task_id == 'o/1'
    assert reassigned.outcome == 'b has it now'
    assert reassigned.failure_id == detected.failure_id
    assert reassigned.time_s - detected.time_s == 4 * SITE.step_s


def test_a_robot_that_loses_its_tasks_is_told_not_to_go_on_with_them(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (a_task(status=TaskStatus.PICKING),)))
    watched.say('motionFault')
    watched.wait()
    assert watched.told() == ['cancelOrder']


def test_a_task_that_no_robot_can_do_is_told_and_ends_when_it_can(watched: Watched) -> None:
    blocked = a_task(robot='', status=TaskStatus.BLOCKED, reason='the stock cell is blocked')
    watched.monitor.know(Tasks(1, (blocked,)))
    said = watched.wait(30)
    watched.monitor.know(Tasks(2, (a_task(),)))

    assert said[:2] == ['FailureDetected NO_ROUTE', 'FailureDiagnosed NO_ROUTE']
    assert 'the stock cell is blocked' in watched.events[0].evidence
    assert watched.wait(8) == ['FailureResolved NO_ROUTE']


def test_a_robot_with_a_task_that_does_nothing_for_long_is_told(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (a_task(status=TaskStatus.ASSIGNED),)))

    assert 'FailureDiagnosed NO_PROGRESS' in watched.wait(200)
    assert not watched.robot().keeps_task
    watched.monitor.know(Tasks(2, (a_task(robot='b', status=TaskStatus.ASSIGNED),)))
    watched.wait()
    assert watched.robot().keeps_task


def test_a_robot_that_stands_because_all_stand_is_not_told(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (a_task(),)))
    watched.operate('pause')

    assert watched.wait(300) == []
