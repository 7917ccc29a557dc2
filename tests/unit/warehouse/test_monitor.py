"""The Monitor: what it sees, what it makes of it, and what it has done about it."""

from typing import Any

import msgspec
import pytest

from warehouse.codec import decode, encode
from warehouse.domain.execution_profiles import read_execution_profiles
from warehouse.domain.monitor import Monitor
from warehouse.domain.order_plan import OrderPlan
from warehouse.domain.robot_failure_profile import read_failure_profile
from warehouse.domain.simulation import Simulation
from warehouse.domain.site import RobotPlace, Site, read_site
from warehouse.messages import (
    ActionState,
    ActionStatus,
    Cell,
    Error,
    ErrorLevel,
    FailureEvent,
    FleetOrders,
    FleetReport,
    FleetState,
    InstantAction,
    Load,
    OperatorCommand,
    OrderNode,
    Position,
    PowerSupply,
    RobotOrder,
    RobotReport,
    RobotState,
    SafetyState,
    Task,
    Tasks,
    TaskStatus,
    ValidatorReport,
    Violation,
    node_id,
)

PROFILES = read_execution_profiles()
TABLE = read_failure_profile()
CHARGER = (9, 3)
SITE = Site(
    'floor',
    ('..........',) * 4,
    stations={'door': (9, 0)},
    products={},
    robots={name: RobotPlace(name, 'carrier', (0, row)) for row, name in enumerate('ab')},
    chargers=(CHARGER,),
    step_s=0.5,
)


class Watched:
    """A Monitor, the states of two robots that stand until they are told otherwise, and time."""

    def __init__(self) -> None:
        self.monitor = Monitor(SITE)
        self.step = 0
        self.states = {
            place.serial_number: RobotState(
                1,
                place.serial_number,
                place.robot_type,
                node_id(place.home),
                Position(0.5, 0.5),
                PowerSupply(100.0),
            )
            for place in SITE.robots.values()
        }
        self.absent: set[str] = set()
        self.events: list[FailureEvent] = []
        self.actions: list[InstantAction] = []
        self.report = FleetReport(0)
        self.wait()

    @property
    def now_s(self) -> float:
        return self.step * SITE.step_s

    def change(self, name: str = 'a', **fields: Any) -> None:
        """The robot's next state is another one."""
        state = self.states[name]
        self.states[name] = msgspec.structs.replace(state, header_id=state.header_id + 1, **fields)

    def say(self, error_type: str = '', level: ErrorLevel = ErrorLevel.FATAL) -> None:
        """The robot reports an error, or none any more."""
        self.change(errors=(Error(error_type, level),) if error_type else ())

    def wait(self, steps: int = 1) -> list[str]:
        """Let steps pass; returns what happened: `FailureDetected PATH_BLOCKED`, ..."""
        before = len(self.events)
        for _ in range(steps):
            self.step += 1
            states = tuple(state for name, state in self.states.items() if name not in self.absent)
            self.monitor.observe(FleetState(self.step, states), self.now_s)
            self.judge()
        return [f'{event.event} {event.code}' for event in self.events[before:]]

    def judge(self) -> None:
        judgement = self.monitor.judge(self.now_s, PROFILES, TABLE)
        self.report = judgement.report
        self.events += judgement.events
        self.actions += judgement.actions.actions

    def order(self, *cells: Cell, name: str = 'a', update: int = 0) -> None:
        """Order the robot to drive, and have it accept the order."""
        self.expect(*cells, name=name, update=update)
        self.change(name, order_id='task#0', order_update_id=update)

    def expect(self, *cells: Cell, name: str = 'a', update: int = 0) -> None:
        nodes = tuple(
            OrderNode(node_id(cell), 2 * number, number < 2) for number, cell in enumerate(cells)
        )
        orders = (RobotOrder(name, 'task#0', update, nodes),) if cells else ()
        self.monitor.expect(FleetOrders(self.step, orders))

    def operate(self, command: str, robot: str = 'a', **more: Any) -> None:
        number = f'{self.step}-{command}-{robot}'
        self.monitor.operate(OperatorCommand(number, command, robot, **more), self.now_s)

    def robot(self, name: str = 'a') -> RobotReport:
        return next(one for one in self.report.robots if one.serial_number == name)

    def restart(self) -> None:
        """Kill the Monitor and start it again from what its last report says over a topic."""
        self.monitor = Monitor(SITE)
        self.monitor.restore(decode(encode(self.report), FleetReport))

    def told(self, name: str = 'a') -> list[str]:
        return [one.action_type for one in self.actions if one.serial_number == name]


@pytest.fixture
def watched() -> Watched:
    return Watched()


def _task(**fields: Any) -> Task:
    task = Task('o/1', 'o', '1', 'tea', 1.0, (5, 0), (9, 0), 0.0, TaskStatus.CARRIED, 'a')
    return msgspec.structs.replace(task, **fields)


# Nothing, and contact.


def test_nothing_is_said_of_robots_that_do_as_they_are_told(watched: Watched) -> None:
    for column in range(1, 9):
        watched.order((column - 1, 0), (column, 0), update=column)
        watched.change(last_node_id=f'{column},0')
        assert watched.wait() == []
    assert watched.robot() == RobotReport('a', watched.states['a'], watched.now_s)
    assert (watched.report.blocked, watched.report.halted, watched.actions) == ((), '', [])


def test_a_silent_robot_is_closed_off_with_the_cell_that_it_may_drive_to(
    watched: Watched,
) -> None:
    watched.order((0, 0), (1, 0))
    watched.wait()
    watched.absent.add('a')

    assert watched.wait() == []
    assert watched.robot().obstacle == ((0, 0), (1, 0))
    assert 'FailureDiagnosed COMM_LOST' in watched.wait(4)
    assert not watched.robot().can_move
    assert (watched.robot().keeps_task, watched.robot().commissioned) == (True, True)


def test_a_robot_that_is_heard_of_again_in_time_goes_on_by_itself(watched: Watched) -> None:
    watched.absent.add('a')
    watched.wait(8)
    watched.absent.clear()

    assert watched.wait() == ['FailureResolved COMM_LOST']
    assert watched.robot().can_move
    assert watched.robot().obstacle == ()


def test_a_robot_that_stays_silent_loses_its_tasks_and_has_to_be_told_to_rejoin(
    watched: Watched,
) -> None:
    watched.absent.add('a')
    said = watched.wait(24)
    lost = watched.robot()
    watched.absent.clear()
    watched.wait(20)
    back = watched.robot()
    watched.operate('rejoinRobot')

    assert 'FailureEscalated ROBOT_LOST' in said
    assert (lost.keeps_task, lost.commissioned, lost.obstacle) == (False, False, ((0, 0),))
    assert (back.commissioned, back.can_move, back.keeps_task) == (False, False, False)
    assert watched.wait() == ['FailureResolved ROBOT_LOST']
    assert watched.robot().commissioned


def test_a_robot_that_is_back_without_its_order_has_crashed(watched: Watched) -> None:
    watched.order((0, 0), (1, 0))
    watched.wait()
    watched.absent.add('a')
    watched.wait(5)
    watched.absent.clear()
    watched.change(order_id='', order_update_id=0)

    assert watched.wait()[:2] == [
        'FailureEscalated SOFTWARE_CRASH',
        'FailureDiagnosed SOFTWARE_CRASH',
    ]
    assert watched.robot().can_move
    assert watched.wait(8)[-1] == 'FailureResolved SOFTWARE_CRASH'


def test_a_robot_that_crashes_again_and_again_is_taken_out_of_service(watched: Watched) -> None:
    for _ in range(3):
        watched.absent.add('a')
        watched.wait(2)
        watched.absent.clear()
        watched.states['a'] = msgspec.structs.replace(watched.states['a'], header_id=0)
        watched.wait(10)
        watched.change()
        watched.wait()

    assert watched.robot().failure == 'OUT_OF_SERVICE'
    assert not watched.robot().commissioned


def test_a_fleet_that_is_silent_as_a_whole_is_no_failure_of_its_robots(watched: Watched) -> None:
    for _ in range(60):
        watched.step += 1
        watched.judge()
    said = [(event.event, event.code, event.robot) for event in watched.events]

    assert ('FailureDetected', 'FLEET_SILENT', '') in said
    assert [robot for _, _, robot in said if robot] == []
    assert watched.wait() == ['FailureResolved FLEET_SILENT']
    assert all(robot.can_move for robot in watched.report.robots)


# Its way.


def _block(watched: Watched, update: int = 1) -> list[str]:
    """Have robot a stand before (1, 0), to which it is ordered, until that cell is blocked."""
    said = []
    for number in range(9):
        watched.order((0, 0), (1, 0), update=update + number)
        said += watched.wait()
    return said


def test_a_robot_that_does_not_begin_to_drive_has_the_cell_ahead_driven_around(
    watched: Watched,
) -> None:
    said = _block(watched)
    blocked = watched.report.blocked
    watched.order((0, 0), (0, 1), update=50)
    watched.change(last_node_id='0,1')

    assert said[:3] == [
        'FailureDetected PATH_BLOCKED',
        'FailureDiagnosed PATH_BLOCKED',
        'ResponseOrdered PATH_BLOCKED',
    ]
    assert [one.cell for one in blocked] == [(1, 0)]
    assert watched.wait() == ['FailureResolved PATH_BLOCKED']
    assert [one.cell for one in watched.report.blocked] == [(1, 0)]


def test_a_cell_found_blocked_is_tried_again_and_the_next_time_for_longer(
    watched: Watched,
) -> None:
    _block(watched)
    first = watched.report.blocked[0]
    watched.expect()
    watched.monitor.know(Tasks(1))
    watched.wait(130)
    tried_again = watched.report.blocked
    for update, (here, there) in enumerate([((0, 0), (0, 1)), ((0, 1), (0, 0))]):
        watched.order(here, there, update=50 + update)
        watched.change(last_node_id=node_id(there))
        watched.wait()
    _block(watched, 100)
    second = watched.report.blocked[0]

    assert tried_again == ()
    assert second.until_s - second.since_s == 2 * (first.until_s - first.since_s)


def test_an_unblocked_cell_is_free_at_once(watched: Watched) -> None:
    _block(watched)
    watched.operate('unblockCell', '', cell=(1, 0))
    watched.wait()

    assert watched.report.blocked == ()


def test_a_robot_that_stands_before_another_robot_is_not_blocked(watched: Watched) -> None:
    watched.change('b', last_node_id='1,0')
    watched.wait(10)
    watched.events.clear()

    assert [said for said in _block(watched) if 'PATH' in said] == []


def test_a_robot_that_can_get_nowhere_hands_its_tasks_on_after_some_tries(
    watched: Watched,
) -> None:
    said = []
    watched.monitor.know(Tasks(1, (_task(),)))
    for update, ahead in enumerate([(1, 0), (0, 1), (1, 0)] * 30):
        watched.order((0, 0), ahead, update=update + 1)
        said += watched.wait()

    assert 'FailureEscalated NODE_UNREACHABLE' in said
    assert not watched.robot().keeps_task
    assert len({event.failure_id for event in watched.events}) == 1


def test_an_order_that_the_robot_did_not_accept_is_no_evidence(watched: Watched) -> None:
    for update in range(20):
        watched.expect((0, 0), (1, 0), update=update + 1)
        assert watched.wait() == []


def test_an_order_that_lapsed_once_is_not_counted_again_and_again(watched: Watched) -> None:
    watched.order((0, 0), (1, 0), update=1)

    assert watched.wait(20) == []


def test_an_order_that_was_carried_out_is_no_order_to_drive_on(watched: Watched) -> None:
    watched.order((0, 0), (1, 0), update=1)
    watched.change(last_node_id='1,0')

    assert watched.wait(20) == []


def test_a_robot_is_delayed_then_stalled_and_well_again_after_even_moves(
    watched: Watched,
) -> None:
    watched.change(driving=True, node_states=('1,0',))
    said = watched.wait(4)
    for column in (1, 2, 3):
        watched.change(last_node_id=f'{column},0', driving=False, node_states=())
        said += watched.wait()

    assert [one for one in said if 'Response' not in one] == [
        'FailureDetected DELAYED',
        'FailureDiagnosed DELAYED',
        'FailureEscalated STALLED',
        'FailureDiagnosed STALLED',
        'FailureResolved STALLED',
    ]


def test_a_hauler_at_its_own_speed_is_not_slow(watched: Watched) -> None:
    watched.states['a'] = msgspec.structs.replace(watched.states['a'], robot_type='hauler')
    watched.monitor = Monitor(SITE)
    said = []
    for column in range(1, 6):
        watched.change(driving=True, node_states=(f'{column},0',))
        said += watched.wait()
        watched.change(last_node_id=f'{column},0', driving=False, node_states=())
        said += watched.wait()

    assert said == []


def test_a_robot_that_was_slow_and_stands_is_not_put_out_of_service(watched: Watched) -> None:
    watched.change(driving=True, node_states=('1,0',))
    watched.wait(4)
    watched.change(last_node_id='1,0', driving=False, node_states=())
    watched.wait(200)

    assert watched.robot().commissioned
    assert watched.robot().failure == ''


def test_a_robot_that_drives_elsewhere_than_ordered_is_off_plan(watched: Watched) -> None:
    watched.order((0, 0), (1, 0), update=1)
    watched.change(last_node_id='0,1')

    assert watched.wait()[1] == 'FailureDiagnosed OFF_PLAN'
    assert watched.events[0].evidence == 'drives to 0,1, was ordered to 1,0'
    assert not watched.robot().can_move
    assert watched.wait(7)[-1] == 'FailureResolved OFF_PLAN'
    assert watched.robot().can_move


def test_an_order_that_comes_after_the_state_that_it_led_to_is_compared_then(
    watched: Watched,
) -> None:
    watched.change(order_id='task#0', order_update_id=1, last_node_id='1,0')
    watched.change('b', order_id='task#0', order_update_id=1, last_node_id='1,1')
    assert watched.wait() == []
    nodes = (OrderNode('0,0', 0), OrderNode('1,0', 2))
    orders = (RobotOrder('a', 'task#0', 1, nodes), RobotOrder('b', 'task#0', 1, nodes))
    watched.monitor.expect(FleetOrders(1, orders))

    watched.wait()
    assert {event.robot for event in watched.events} == {'b'}


def test_a_robot_that_is_off_plan_again_and_again_has_lost_its_localization(
    watched: Watched,
) -> None:
    for update, row in enumerate((1, 2, 3)):
        watched.order((0, row - 1), (1, row - 1), update=update + 1)
        watched.change(last_node_id=f'0,{row}')
        watched.wait(8)

    assert watched.robot().failure == 'LOCALIZATION_ERROR'
    assert watched.told()[:1] == ['startPause']


def test_a_robot_that_leaps_has_lost_its_localization_and_gets_room(watched: Watched) -> None:
    watched.change(last_node_id='6,2')

    assert 'FailureDiagnosed LOCALIZATION_ERROR' in watched.wait()
    assert set(watched.robot().obstacle) == {(6, 2), (5, 2), (7, 2), (6, 1), (6, 3)}
    watched.wait(41)
    assert watched.robot().obstacle == ((6, 2),)


def test_steps_that_nobody_saw_say_nothing(watched: Watched) -> None:
    watched.change(driving=True, node_states=('1,0',))
    watched.wait()
    watched.step += 10
    watched.change(last_node_id='1,0', driving=False, node_states=())

    assert watched.wait() == []


# Its battery.


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


# Its load and its actions.


def test_a_pick_that_waits_for_a_retry_is_tried_again_and_then_given_up(
    watched: Watched,
) -> None:
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


def test_a_load_above_what_the_type_carries_stops_nobody_from_being_told(
    watched: Watched,
) -> None:
    watched.change(loads=(Load('o/1', 'anvil', 99.0),))

    assert 'FailureDiagnosed OVERWEIGHT' in watched.wait()
    assert watched.events[0].evidence == 'carries 99 kg, more than 30 kg'


# Who has its tasks.


def test_the_time_to_the_robot_that_takes_over_can_be_seen_from_events(
    watched: Watched,
) -> None:
    watched.monitor.know(Tasks(1, (_task(),)))
    watched.change(loads=(Load('o/1'),))
    watched.wait()
    watched.say('motionFault')
    watched.wait()
    kept = watched.robot().keeps_task
    watched.monitor.know(Tasks(2, (_task(robot='', status=TaskStatus.OPEN),)))
    watched.wait(3)
    watched.monitor.know(Tasks(3, (_task(robot='b', status=TaskStatus.ASSIGNED),)))
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
    watched.monitor.know(Tasks(1, (_task(status=TaskStatus.PICKING),)))
    watched.say('motionFault')
    watched.wait()
    assert watched.told() == ['cancelOrder']


def test_a_task_that_no_robot_can_do_is_told_and_ends_when_it_can(watched: Watched) -> None:
    blocked = _task(robot='', status=TaskStatus.BLOCKED, reason='the stock cell is blocked')
    watched.monitor.know(Tasks(1, (blocked,)))
    said = watched.wait(30)
    watched.monitor.know(Tasks(2, (_task(),)))

    assert said[:2] == ['FailureDetected NO_ROUTE', 'FailureDiagnosed NO_ROUTE']
    assert 'the stock cell is blocked' in watched.events[0].evidence
    assert watched.wait(8) == ['FailureResolved NO_ROUTE']


def test_a_robot_with_a_task_that_does_nothing_for_long_is_told(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (_task(status=TaskStatus.ASSIGNED),)))

    assert 'FailureDiagnosed NO_PROGRESS' in watched.wait(200)
    assert not watched.robot().keeps_task
    watched.monitor.know(Tasks(2, (_task(robot='b', status=TaskStatus.ASSIGNED),)))
    watched.wait()
    assert watched.robot().keeps_task


def test_a_robot_that_stands_because_all_stand_is_not_told(watched: Watched) -> None:
    watched.monitor.know(Tasks(1, (_task(),)))
    watched.operate('pause')

    assert watched.wait(300) == []


# People.


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


def test_a_broken_rule_stops_all_until_it_is_acknowledged_and_resumed(
    watched: Watched,
) -> None:
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


# Risk.


def test_a_robot_that_has_failed_is_a_risk_that_fades(watched: Watched) -> None:
    watched.change(power_supply=PowerSupply(20.0))
    watched.wait()
    risk = watched.robot().risk
    watched.change(power_supply=PowerSupply(90.0))
    watched.wait()

    assert 0 < risk <= 1
    assert watched.robot().risk == risk
    watched.step += 8000
    watched.change(power_supply=PowerSupply(20.0))
    watched.wait()
    assert watched.robot().risk == risk


# Restarts.


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
    _block(watched)
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


# With the real fleet.

STEPS_OF = {code: response.steps for code, response in PROFILES.responses.items()}


@pytest.mark.parametrize(
    'code',
    [
        'PATH_BLOCKED', 'NODE_UNREACHABLE', 'DELAYED', 'STALLED', 'MOTION_FAULT',
        'LOCALIZATION_ERROR', 'LOW_BATTERY', 'BATTERY_CRITICAL', 'BATTERY_DEPLETED',
        'PICK_FAILED', 'LOAD_MISSING', 'OVERWEIGHT', 'MISFIT', 'LOAD_DROPPED', 'COMM_LOST',
        'EMERGENCY_STOP', 'FIELD_VIOLATION', 'OUTSIDE_OF_CORRIDOR', 'OFF_PLAN',
        'ORDER_REJECTED', 'CHARGER_FAULT', 'SOFTWARE_CRASH', 'UNKNOWN',
    ],
)  # fmt: skip
def test_what_fails_in_the_fleet_is_found_answered_and_over_after_repair(code: str) -> None:
    simulation = Simulation(
        read_site(), PROFILES, TABLE, seed=3, orders=OrderPlan(per_hour=900), repair_s=None
    )
    simulation.run(60)
    while not (loaded := [state for state in simulation.state.states if state.loads]):
        simulation.step()
    name = loaded[0].serial_number
    simulation.command('failRobot', name, failure=code)
    if code == 'CHARGER_FAULT':
        simulation.command('failRobot', name, failure='LOW_BATTERY')
    simulation.run(200)
    mine = [event for event in simulation.failures if event.robot == name]
    simulation.command('repairRobot', name)
    simulation.run(6)
    simulation.command('rejoinRobot', name)
    simulation.run(60)
    report = next(one for one in simulation.report.robots if one.serial_number == name)
    others = {event.robot for event in simulation.failures} - {name, ''}

    assert code in {event.code for event in mine if event.event == 'FailureDiagnosed'}
    answers = [
        event.response for event in mine if event.event == 'ResponseOrdered' and event.code == code
    ]
    assert answers[:1] == list(STEPS_OF[code][:1])
    assert set(answers) <= {*STEPS_OF[code], 'wait'}
    assert (report.commissioned, report.can_move, report.keeps_task) == (True, True, True)
    assert simulation.validator.finish() == ()
    # A pallet is in the way of others, too, and the load of a silent robot may be elsewhere.
    assert others == set() or code in ('PATH_BLOCKED', 'CHARGER_FAULT', 'COMM_LOST')


def test_nothing_is_found_where_nothing_fails() -> None:
    simulation = Simulation(
        read_site(), PROFILES, TABLE, seed=5, orders=OrderPlan(per_hour=900), repair_s=None
    )
    simulation.run(1500)

    assert {event.code for event in simulation.failures} <= {'LOW_BATTERY'}


@pytest.mark.parametrize('seed', [1, 2])
def test_nothing_is_found_where_messages_are_late_and_the_monitor_is_killed_again_and_again(
    seed: int,
) -> None:
    simulation = Simulation(
        read_site(),
        PROFILES,
        TABLE,
        seed=seed,
        orders=OrderPlan(per_hour=900),
        repair_s=None,
        lateness=0.3,
    )
    for _ in range(20):
        simulation.run(37)
        simulation.restart('monitor')

    assert {event.code for event in simulation.failures} <= {'LOW_BATTERY'}
