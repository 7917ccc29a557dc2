"""The Task Organizer makes a task of each line, and knows where each load is."""

from typing import Any

import pytest
from msgspec.structs import replace

from warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from warehouse.domain.site import Product, RobotPlace, Site
from warehouse.domain.task_organizer import TaskOrganizer
from warehouse.messages import (
    ActionState,
    ActionStatus,
    Assignment,
    Assignments,
    Blocked,
    Cell,
    Costs,
    Error,
    ErrorLevel,
    FleetReport,
    FleetState,
    LineStatus,
    Load,
    OpenOrders,
    Order,
    OrderLine,
    Position,
    PowerSupply,
    RobotReport,
    RobotState,
    Task,
    TaskStatus,
    node_id,
)

PROFILES = ExecutionProfiles(
    {
        'carrier': RobotType('carrier', max_load_kg=30, sizes=('small',)),
        'hauler': RobotType('hauler', max_load_kg=120, sizes=('small', 'large')),
    }
)
NEAR, FAR, STATION = (2, 0), (5, 2), (0, 0)
SITE = Site(
    'test',
    ('......', '.@@@@.', '......'),
    {'s': STATION, 't': (0, 2)},
    {
        'tea': Product('tea', (FAR, NEAR), 2.0),
        'desk': Product('desk', (FAR,), 50.0, 'large'),
        'pool': Product('pool', (FAR,), 1.0, 'huge'),
    },
    {'r': RobotPlace('r', 'carrier', (0, 0)), 'q': RobotPlace('q', 'hauler', (0, 0))},
)
UNDER_WAY, FINISHED, FAILED = ActionStatus.RUNNING, ActionStatus.FINISHED, ActionStatus.FAILED


def order(*lines: OrderLine, order_id: str = 'a', **more: Any) -> Order:
    lines = lines or (OrderLine('1', 'tea', 3),)
    return Order(order_id, more.pop('update', 0), more.pop('station', 's'), lines, 1.0, **more)


class Hall:
    """An organizer, and what its peers tell it."""

    def __init__(self, *orders: Order) -> None:
        self.organizer = TaskOrganizer(SITE)
        self.step = 0
        self.robots: dict[str, RobotState] = {}
        self.gone: dict[str, RobotState] = {}
        self.gave_up: set[str] = set()
        self.removed: set[str] = set()
        self.costs: dict[str, str] | None = None
        self.assigned: dict[str, str] = {}
        self.blocked: tuple[Cell, ...] = ()
        for name in ('r', 'q'):
            self.robot(name)
        self.orders(*(orders or (order(),)))

    def orders(self, *orders: Order) -> None:
        self.organizer.take(OpenOrders(orders))

    def robot(
        self,
        name: str,
        *actions: tuple[str, ActionStatus, str],
        load: str = '',
        cell: Cell = (3, 0),
        errors: tuple[Error, ...] = (),
    ) -> None:
        states = tuple(
            ActionState(action_id, action_id.rpartition(':')[2], status, result)
            for action_id, status, result in actions
        )
        self.gone.pop(name, None)
        self.robots[name] = RobotState(
            1,
            name,
            'carrier' if name == 'r' else 'hauler',
            node_id(cell),
            Position(0.0, 0.0),
            PowerSupply(90.0),
            action_states=states,
            loads=(Load(load),) if load else (),
            errors=errors,
        )

    def silence(self, name: str) -> None:
        self.gone[name] = self.robots.pop(name)

    def now(self, steps: int = 1) -> Task:
        """The one task, after some steps."""
        self.go_on(steps)
        return self.organizer.tasks().tasks[0]

    def go_on(self, steps: int) -> None:
        for _ in range(steps):
            self.step += 1
            reports = [
                RobotReport(
                    name,
                    state,
                    0.0,
                    keeps_task=name not in self.gave_up,
                    failure='REMOVED' if name in self.removed else '',
                )
                for name, state in (self.robots | self.gone).items()
            ]
            blocked = tuple(Blocked(cell, 'pallet') for cell in self.blocked)
            self.organizer.follow(
                FleetState(self.step, tuple(self.robots.values())),
                FleetReport(self.step, tuple(reports), blocked),
                None if self.costs is None else Costs(self.step, infeasible=self.costs),
                Assignments(
                    self.step,
                    tuple(Assignment(name, (task,)) for name, task in self.assigned.items()),
                ),
                PROFILES,
                0.0,
            )

    def restart(self, *orders: Order) -> None:
        self.organizer = TaskOrganizer(SITE)
        self.orders(*(orders or (order(),)))


def carried(robot: str = 'r') -> Hall:
    hall = Hall()
    hall.now()
    hall.robot(robot, ('a/1#0:pick', FINISHED, ''), load='a/1')
    assert hall.now().status is TaskStatus.CARRIED
    return hall


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
    hall = Hall()
    hall.now()
    hall.orders(CHANGED)
    hall.now(3)
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    task = hall.now(20)
    assert (task.product, task.quantity, task.status) == ('tea', 3, TaskStatus.CARRIED)


def test_an_organizer_that_starts_again_after_a_change_believes_the_load_that_was_picked() -> None:
    hall = Hall()
    hall.now()
    hall.restart(CHANGED)
    hall.now()
    hall.robot('r', ('a/1#0:pick', FINISHED, ''), load='a/1')
    loads = (Load('a/1', 'tea', 6.0),)
    hall.robots['r'] = replace(hall.robots['r'], loads=loads)
    task = hall.now()
    assert (task.product, task.quantity, task.weight_kg) == ('tea', 3, 6.0)


def test_a_change_that_is_taken_back_leaves_the_task_as_it_was() -> None:
    hall = Hall()
    hall.now()
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
    hall = Hall()
    hall.now()
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


# Failures of a pick


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
    hall = Hall()
    hall.now()
    hall.robot('r', ('a/1#0:pick', ActionStatus.RETRIABLE, 'PICK_FAILED'))
    assert hall.now().status is TaskStatus.PICKING
    hall.robot('r', ('a/1#0:pick', FAILED, 'PICK_FAILED'))
    task = hall.now(3)
    assert (task.status, task.attempt, task.excluded) == (TaskStatus.OPEN, 1, ('r',))


def test_a_type_of_robot_for_which_a_load_is_too_heavy_is_excluded() -> None:
    hall = Hall()
    hall.now()
    hall.robot('r', ('a/1#0:pick', FAILED, 'OVERWEIGHT'))
    assert hall.now().excluded == ('carrier',)


def test_a_load_that_was_too_heavy_for_all_is_tried_again_and_fails_after_three_tries() -> None:
    hall = Hall()
    hall.now()
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


# Robots that fail


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
    hall = Hall()
    hall.now()
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
    hall = Hall()
    hall.now()
    before = hall.organizer.tasks().tasks
    hall.organizer.take(OpenOrders((replace(order()),)))
    hall.now()
    assert hall.organizer.tasks().tasks is before
