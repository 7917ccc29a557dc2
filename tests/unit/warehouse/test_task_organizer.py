"""The Task Organizer makes a task of each line, and knows where each load is."""

import pytest
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

from ros2_kafka_warehouse.domain.task_organizer import TaskOrganizer
from ros2_kafka_warehouse.messages.orders import LineStatus, OpenOrders, Order, OrderLine
from ros2_kafka_warehouse.messages.robots import ActionStatus, Load
from ros2_kafka_warehouse.messages.tasks import TaskStatus

# Orders


def test_each_line_becomes_a_task_with_its_weight_and_the_nearest_stock_cell() -> None:
    hall = Hall(order(OrderLine('1', 'tea', 3), OrderLine('2', 'desk'), priority=4, due_s=9.0))
    task = hall.now()
    assert task.task_id == 'a/1'
    assert (task.weight_kg, task.pickup, task.delivery) == (6.0, NEAR, STATION)
    assert (task.priority, task.due_s, task.released_s) == (4, 9.0, 1.0)
    assert [it.task_id for it in hall.organizer.tasks().tasks] == ['a/1', 'a/2']


@pytest.mark.parametrize(
    ('line', 'reason'),
    [
        (OrderLine('1', 'tea', 61), 'no type of robot here can carry 122 kg of size small'),
        (OrderLine('1', 'pool'), 'no type of robot here can carry 1 kg of size huge'),
    ],
)
def test_a_line_that_no_type_of_robot_can_carry_has_failed(line: OrderLine, reason: str) -> None:
    task = Hall(order(line)).now()
    assert (task.status, task.reason) == (TaskStatus.FAILED, reason)


def test_nothing_is_said_before_orders_and_robots_were_heard() -> None:
    organizer = TaskOrganizer(SITE)
    assert organizer.tasks().tasks == ()
    organizer.take(OpenOrders((order(),)))
    assert organizer.tasks().tasks == ()


CHANGED = order(OrderLine('1', 'desk'), update=1)


def test_a_change_makes_the_task_anew_once_nobody_can_still_pick_the_old_one() -> None:
    hall = Hall()
    hall.assigned = {'r': 'a/1'}
    hall.now()
    hall.orders(CHANGED)
    task = hall.now(20)
    assert (task.product, task.status) == ('tea', TaskStatus.OPEN), 'its robot may be there'
    assert task.excluded == ('carrier', 'hauler')
    hall.assigned = {}
    hall.now()
    task = hall.now()
    assert (task.product, task.pickup, task.attempt) == ('desk', FAR, 1)
    assert task.excluded == ()


def test_a_load_that_was_picked_before_the_change_came_is_what_is_delivered() -> None:
    hall = Hall().begun()
    hall.orders(CHANGED)
    hall.now(3)
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    task = hall.now(20)
    assert (task.product, task.quantity, task.status) == ('tea', 3, TaskStatus.CARRIED)


def test_an_organizer_that_starts_again_after_a_change_believes_the_load_that_was_picked() -> None:
    hall = Hall().begun()
    hall.restart(CHANGED)
    hall.now()
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    loads = (Load('a/1', 'tea', 6.0),)
    hall.robots['r'] = replace(hall.robots['r'], loads=loads)
    task = hall.now()
    assert (task.product, task.quantity, task.weight_kg) == ('tea', 3, 6.0)


def test_a_change_that_is_taken_back_leaves_the_task_as_it_was() -> None:
    hall = Hall().begun()
    hall.orders(CHANGED)
    hall.now(2)
    hall.orders(order(update=2))
    task = hall.now(20)
    assert (task.product, task.attempt, task.excluded) == ('tea', 0, ())


@pytest.mark.parametrize('hall', [Hall(), carried()])
def test_another_station_holds_at_once(hall: Hall) -> None:
    hall.now()
    hall.orders(order(station='t', update=1))
    task = hall.now()
    assert (task.delivery, task.attempt) == ((0, 2), 0)


def test_another_station_comes_too_late_when_the_robot_stands_at_the_old_one() -> None:
    hall = carried()
    hall.robot('r', load='a/1', cell=STATION)
    hall.now()
    hall.orders(order(station='t', update=1))
    assert hall.now().delivery == STATION


@pytest.mark.parametrize(
    'gone', [order(cancelled=True), order(OrderLine('1', 'tea', 3, withdrawn=True))]
)
def test_a_task_that_is_not_wanted_is_cancelled_once_nobody_can_still_pick_it(gone: Order) -> None:
    hall = Hall()
    hall.assigned = {'r': 'a/1'}
    assert hall.now().status is TaskStatus.ASSIGNED
    hall.orders(gone)
    task = hall.now()
    assert (task.status, task.excluded) == (TaskStatus.OPEN, ('carrier', 'hauler'))
    hall.now(20)
    assert hall.now().status is TaskStatus.OPEN, 'its robot might still be on its way'
    hall.assigned = {}
    assert hall.now().status is TaskStatus.CANCELLED


def test_a_load_that_was_picked_before_the_cancelling_came_is_delivered() -> None:
    hall = Hall().begun()
    hall.orders(order(cancelled=True))
    hall.robot('r', ('a/1#0:pick', UNDER_WAY, ''))
    assert hall.now(20).status is TaskStatus.PICKING
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    assert hall.now(20).status is TaskStatus.CARRIED


def test_a_load_of_a_cancelled_order_on_a_failed_robot_is_brought_by_another() -> None:
    hall = carried()
    hall.gave_up = {'r'}
    hall.now()
    hall.orders(order(cancelled=True))
    assert hall.now(8).status is TaskStatus.CANCELLED
    hall.now(10)
    hall.orders(order(OrderLine('1', 'tea', 3, LineStatus.CANCELLED), cancelled=True))
    attempt = hall.now().attempt
    task = hall.now(50)
    assert (task.status, task.attempt) == (TaskStatus.OPEN, attempt)
    assert (task.stranded, task.excluded) == (True, ('r',))


def test_an_order_that_ended_and_comes_back_is_not_done_again() -> None:
    hall = carried()
    hall.robot('r', ('a/1#0:drop', FINISHED, ''))
    hall.now()
    hall.orders()
    hall.robot('r')
    hall.step += 1
    hall.orders(order())
    assert hall.now().status is TaskStatus.DELIVERED


# How a task goes on


def test_a_task_goes_from_open_to_delivered() -> None:
    hall = Hall()
    assert hall.now().status is TaskStatus.OPEN
    hall.assigned = {'r': 'a/1'}
    task = hall.now()
    assert (task.status, task.robot) == (TaskStatus.ASSIGNED, 'r')
    hall.robot('r', ('a/1#0:pick', UNDER_WAY, ''))
    assert hall.now().status is TaskStatus.PICKING
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    task = hall.now()
    assert (task.status, task.carried, task.robot) == (TaskStatus.CARRIED, True, 'r')
    hall.robot('r', ('a/1#0:drop', FINISHED, ''))
    task = hall.now()
    assert (task.status, task.carried) == (TaskStatus.DELIVERED, False)


def test_a_task_that_nobody_can_do_is_blocked_until_somebody_can() -> None:
    hall = Hall()
    hall.costs = {'a/1': 'no way'}
    task = hall.now()
    assert (task.status, task.reason) == (TaskStatus.BLOCKED, 'no way')
    hall.costs = {}
    assert (hall.now().status, hall.now().reason) == (TaskStatus.OPEN, '')


def test_a_load_whose_way_is_blocked_is_still_carried() -> None:
    hall = carried()
    hall.costs = {'a/1': 'no way'}
    task = hall.now()
    assert (task.status, task.carried, task.robot) == (TaskStatus.BLOCKED, True, 'r')
    hall.costs = {}
    assert hall.now().status is TaskStatus.CARRIED


def test_another_stock_cell_is_taken_when_the_first_is_blocked() -> None:
    hall = Hall()
    hall.blocked = (NEAR,)
    hall.costs = {'a/1': 'blocked'}
    assert hall.now().pickup == FAR


# Restart


@pytest.mark.parametrize(
    ('actions', 'load', 'status', 'attempt'),
    [
        ((), '', TaskStatus.OPEN, 0),
        ((('a/1#0:pick', UNDER_WAY, ''),), '', TaskStatus.PICKING, 0),
        ((('a/1#0:pick', FINISHED, ''),), 'a/1', TaskStatus.CARRIED, 0),
        (
            (('a/1#0:drop', FINISHED, ''), ('a/1#0:pick', FINISHED, '')),
            '',
            TaskStatus.DELIVERED,
            0,
        ),
        ((('a/1#2:pick', FAILED, 'cancelled'),), '', TaskStatus.OPEN, 3),
    ],
)
def test_an_organizer_that_starts_again_knows_it_all_from_the_robots(
    actions: tuple[tuple[str, ActionStatus, str], ...],
    load: str,
    status: TaskStatus,
    attempt: int,
) -> None:
    hall = Hall()
    hall.robot('r', *actions, load=load)
    task = hall.now()
    hall.restart()
    assert hall.now() == task
    assert (task.status, task.attempt) == (status, attempt)


def test_what_robots_said_before_an_order_was_known_counts_for_it() -> None:
    hall = Hall()
    hall.organizer = TaskOrganizer(SITE)
    hall.orders()
    hall.robot('r', ('a/1#0:drop', FINISHED, ''))
    hall.go_on(2)
    hall.orders(order())
    assert hall.now().status is TaskStatus.DELIVERED


def test_an_organizer_that_starts_again_finds_the_load_of_a_silent_robot() -> None:
    hall = carried()
    hall.silence('r')
    hall.gave_up = {'r'}
    hall.now()
    hall.restart()
    task = hall.now()
    assert (task.stranded, task.pickup, task.excluded) == (True, (3, 0), ('r',))


def test_an_organizer_that_starts_again_knows_from_the_order_where_a_load_stands() -> None:
    line = OrderLine('1', 'tea', 3, place=(4, 2), attempt=2)
    hall = Hall()
    hall.restart(order(line))
    task = hall.now()
    assert (task.stranded, task.pickup, task.attempt) == (True, (4, 2), 2)


def test_lines_that_have_ended_stay_so_after_a_restart() -> None:
    hall = Hall()
    hall.restart(order(OrderLine('1', 'tea', 3, LineStatus.DELIVERED)))
    assert hall.now().status is TaskStatus.DELIVERED


def test_tasks_that_have_not_changed_are_the_same_values() -> None:
    hall = Hall().begun()
    before = hall.organizer.tasks().tasks
    hall.organizer.take(OpenOrders((replace(order()),)))
    hall.now()
    assert hall.organizer.tasks().tasks is before
