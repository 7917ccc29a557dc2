"""What becomes of a task whose pick fails, or whose robot does."""

from msgspec.structs import replace
from support.warehouse.robot_hall import (
    FAILED,
    FAR,
    FINISHED,
    NEAR,
    SITE,
    STATION,
    UNDER_WAY,
    Hall,
    carried,
    order,
)

from ros2_kafka_warehouse.domain.site import RobotPlace
from ros2_kafka_warehouse.domain.task_organizer import TaskOrganizer
from ros2_kafka_warehouse.messages.orders import OrderLine
from ros2_kafka_warehouse.messages.robots import ActionStatus, Error, ErrorLevel
from ros2_kafka_warehouse.messages.tasks import TaskStatus


def test_a_missing_load_is_looked_for_in_the_other_stock_cell_and_then_the_line_fails() -> None:
    hall = Hall()
    pickups = []
    for attempt in range(3):
        task = hall.now()
        assert task.attempt == attempt
        pickups.append(task.pickup)
        hall.robot('r', (f'a/1#{attempt}:pick', FAILED, 'LOAD_MISSING'))
    task = hall.now()
    assert pickups[:2] == [NEAR, FAR]
    assert (task.status, task.reason) == (
        TaskStatus.FAILED,
        'LOAD_MISSING: picked 3 times in vain',
    )


def test_a_robot_that_fails_to_pick_is_not_sent_again() -> None:
    hall = Hall().begun()
    hall.robot('r', ('a/1#0:pick', ActionStatus.RETRIABLE, 'PICK_FAILED'))
    assert hall.now().status is TaskStatus.PICKING
    hall.robot('r', ('a/1#0:pick', FAILED, 'PICK_FAILED'))
    task = hall.now(3)
    assert (task.status, task.attempt, task.excluded) == (TaskStatus.OPEN, 1, ('r',))


def test_a_type_of_robot_for_which_a_load_is_too_heavy_is_excluded() -> None:
    hall = Hall().begun()
    hall.robot('r', ('a/1#0:pick', FAILED, 'OVERWEIGHT'))
    assert hall.now().excluded == ('carrier',)


def test_a_load_that_was_too_heavy_for_all_is_tried_again_and_fails_after_three_tries() -> None:
    hall = Hall().begun()
    hall.robot('r', ('a/1#0:pick', FAILED, 'OVERWEIGHT'))
    hall.now()
    hall.robot('q', ('a/1#1:pick', FAILED, 'MISFIT'))
    assert hall.now().excluded == ('carrier', 'hauler')
    hall.costs = {'a/1': 'no robot in service can carry tea (6 kg)'}
    assert hall.now().status is TaskStatus.BLOCKED
    hall.costs = {}
    task = hall.now(2)
    assert (task.status, task.excluded) == (TaskStatus.OPEN, ())
    hall.robot('r', ('a/1#2:pick', FAILED, 'OVERWEIGHT'))
    task = hall.now()
    assert (task.status, task.reason) == (
        TaskStatus.FAILED,
        'OVERWEIGHT: picked 3 times in vain',
    )


def test_a_line_that_no_robot_of_the_site_can_carry_has_failed() -> None:
    carriers = {name: RobotPlace(name, 'carrier', (0, 0)) for name in ('r', 'q')}
    hall = Hall()
    hall.organizer = TaskOrganizer(replace(SITE, robots=carriers))
    hall.orders(order(OrderLine('1', 'desk')))
    task = hall.now()
    assert (task.status, task.reason) == (
        TaskStatus.FAILED,
        'no type of robot here can carry 50 kg of size large',
    )


def test_a_pick_that_was_cancelled_is_only_numbered_anew() -> None:
    hall = Hall()
    for attempt in range(5):
        hall.now()
        hall.robot('r', (f'a/1#{attempt}:pick', FAILED, 'cancelled'))
    task = hall.now()
    assert (task.status, task.attempt, task.excluded) == (TaskStatus.OPEN, 5, ())


def test_a_failed_drop_is_tried_again_under_another_number() -> None:
    hall = carried()
    hall.robot('r', ('a/1#0:drop', FAILED, 'cancelled'), load='a/1')
    task = hall.now(2)
    assert (task.status, task.robot, task.attempt) == (TaskStatus.CARRIED, 'r', 1)


def test_the_load_of_a_failed_robot_is_to_be_picked_from_where_it_stands() -> None:
    hall = carried()
    hall.robot('r', load='a/1', cell=(4, 0))
    hall.gave_up = {'r'}
    task = hall.now(3)
    assert (task.status, task.carried, task.stranded) == (TaskStatus.OPEN, False, True)
    assert (task.pickup, task.attempt, task.excluded) == ((4, 0), 1, ('r',))
    hall.robot('q', ('a/1#1:pick', FINISHED, ''), load='a/1')
    hall.robot('r')
    task = hall.now()
    assert (task.status, task.robot, task.stranded) == (TaskStatus.CARRIED, 'q', False)


def test_a_repaired_robot_goes_on_with_the_load_that_it_still_has() -> None:
    hall = carried()
    hall.gave_up = {'r'}
    hall.now()
    hall.gave_up = set()
    task = hall.now()
    assert (task.status, task.robot, task.stranded) == (TaskStatus.CARRIED, 'r', False)
    assert task.excluded == ()


def test_a_silent_robot_is_trusted_with_its_load_until_the_monitor_gives_it_up() -> None:
    hall = carried()
    hall.silence('r')
    assert hall.now(10).status is TaskStatus.CARRIED
    hall.gave_up = {'r'}
    task = hall.now()
    assert (task.stranded, task.pickup) == (True, (3, 0))


def test_what_a_silent_robot_has_done_counts_when_it_is_heard_again() -> None:
    hall = carried()
    hall.silence('r')
    hall.gave_up = {'r'}
    hall.now()
    hall.robot('r', ('a/1#0:drop', FINISHED, ''))
    assert hall.now().status is TaskStatus.DELIVERED


def test_a_silent_robot_does_not_get_back_a_load_that_another_has_taken_and_delivered() -> None:
    hall = carried()
    hall.silence('r')
    hall.gave_up = {'r'}
    hall.now()
    hall.robot('q', ('a/1#1:pick', FINISHED, ''), load='a/1')
    hall.now()
    # It slides off the second robot, where only that one can have lost it.
    hall.robot('q', ('a/1#1:pick', FINISHED, ''), cell=(5, 0))
    hall.gave_up = {'r', 'q'}
    assert hall.now().pickup == (5, 0)
    hall.gave_up = {'r'}
    hall.robot('q', ('a/1#2:drop', FINISHED, ''))
    assert hall.now(20).status is TaskStatus.DELIVERED
    hall.orders()
    hall.step += 20
    hall.orders(order(order_id='b'))
    assert hall.now(20).task_id == 'b/1'


def test_a_robot_that_fell_silent_on_its_pick_may_have_the_load_or_not() -> None:
    hall = Hall().begun()
    hall.robot('r', ('a/1#0:pick', UNDER_WAY, ''), cell=NEAR)
    hall.now()
    hall.silence('r')
    hall.gave_up = {'r'}
    task = hall.now()
    assert (task.stranded, task.pickup, task.attempt) == (True, NEAR, 1)
    hall.robot('q', ('a/1#1:pick', FAILED, 'LOAD_MISSING'))
    task = hall.now()
    assert (task.stranded, task.pickup in (NEAR, FAR), task.attempt) == (False, True, 2)


def test_a_load_that_is_not_where_its_silent_robot_was_waits_for_that_robot() -> None:
    hall = carried()
    hall.silence('r')
    hall.gave_up = {'r'}
    for attempt in range(3):
        hall.now()
        hall.robot('q', (f'a/1#{attempt + 1}:pick', FAILED, 'LOAD_MISSING'))
    task = hall.now()
    assert (task.status, task.excluded) == (TaskStatus.BLOCKED, ('carrier', 'hauler'))
    assert task.reason == 'its load is not at (3, 0), where it was last seen'
    hall.robot('r', load='a/1', cell=(4, 0))
    task = hall.now()
    assert (task.status, task.pickup) == (TaskStatus.OPEN, (4, 0))


def test_a_load_is_lost_with_the_robot_that_was_removed_and_the_line_fails() -> None:
    hall = carried()
    hall.silence('r')
    hall.gave_up = hall.removed = {'r'}
    assert hall.now().status is TaskStatus.OPEN, 'it may stand on the floor there'
    for attempt in range(3):
        hall.now()
        hall.robot('q', (f'a/1#{attempt + 1}:pick', FAILED, 'LOAD_MISSING'))
    assert hall.now().status is TaskStatus.FAILED


def test_a_load_that_slid_off_lies_where_its_robot_stands() -> None:
    hall = carried()
    error = Error('loadDropped', ErrorLevel.CRITICAL)
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), cell=(4, 0), errors=(error,))
    assert hall.now(10).status is TaskStatus.CARRIED, 'the Monitor has the word'
    hall.gave_up = {'r'}
    task = hall.now()
    assert (task.stranded, task.pickup, task.attempt) == (True, (4, 0), 1)


def test_a_pick_that_was_undone_by_a_restart_of_the_robots_is_to_be_done_again() -> None:
    hall = carried()
    hall.robot('r')
    task = hall.now(10)
    assert (task.status, task.stranded, task.attempt) == (TaskStatus.OPEN, False, 1)


def test_a_load_that_was_lost_before_it_was_seen_is_picked_under_another_number() -> None:
    hall = carried()
    hall.gave_up = {'r'}
    hall.robot('r', cell=(4, 0))
    assert hall.now().stranded
    hall.gave_up = set()
    hall.robot('r', ('a/1#1:pick', FINISHED, ''), cell=(4, 0))  # and it has slid off again
    task = hall.now(2)
    assert (task.status, task.stranded, task.attempt) == (TaskStatus.OPEN, True, 2)


def test_a_load_whose_order_has_ended_is_brought_to_a_station() -> None:
    hall = carried()
    hall.robot('r', ('a/1#0:drop', FINISHED, ''))
    hall.now()
    hall.orders()
    hall.robot('r', load='a/1')  # the robots were set back by a restart
    task = hall.now(10)
    assert (task.task_id, task.status, task.delivery) == ('a/1', TaskStatus.CARRIED, STATION)
    assert task.attempt == 1
    hall.robot('r', ('a/1#1:drop', FINISHED, ''))
    hall.go_on(2)
    assert hall.organizer.tasks().tasks == ()


def test_a_load_that_nobody_knows_is_brought_to_a_station() -> None:
    hall = Hall()
    hall.orders()
    hall.robot('r', load='x/9', cell=(0, 1))
    task = hall.now(10)
    assert (task.task_id, task.status, task.robot) == ('x/9', TaskStatus.CARRIED, 'r')
