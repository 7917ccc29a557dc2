"""The desk takes each order once, whatever is repeated, and every order ends once."""

from collections import Counter
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.bridges.shop import ENDS, SITE, Shop, request, said, task

from ros2_kafka_warehouse.domain.orders import OrderDesk, event_name
from ros2_kafka_warehouse.messages.orders import Line, OrderEvent, OrderRequest, OrderStatus
from ros2_kafka_warehouse.messages.tasks import Assignment, Assignments, Task, Tasks, TaskStatus

# What becomes of them


def test_an_order_goes_as_far_as_its_farthest_line_and_never_says_the_same_again() -> None:
    shop = Shop()
    shop.ask(request())
    one, other = task('a', '1', TaskStatus.OPEN), task('a', '2', TaskStatus.OPEN)
    assert said(shop.now(one, other)) == [('', OrderStatus.PLANNED)]
    assert said(shop.now(replace(one, status=TaskStatus.ASSIGNED))) == [('', OrderStatus.ASSIGNED)]
    assert said(shop.now(replace(one, status=TaskStatus.PICKING))) == [('', OrderStatus.PICKING)]
    assert said(shop.now(task('a', '1', TaskStatus.CARRIED))) == [('', OrderStatus.CARRYING)]
    assert shop.now() == ()
    assert said(shop.now(task('a', '1', TaskStatus.DELIVERED))) == [('1', OrderStatus.DELIVERED)]
    assert said(shop.now(task('a', '2', TaskStatus.CARRIED))) == []
    assert said(shop.now(task('a', '2', TaskStatus.DELIVERED))) == [
        ('2', OrderStatus.DELIVERED),
        ('', OrderStatus.DELIVERED),
    ]
    assert shop.desk.open().orders == ()
    assert shop.now() == ()


def test_a_blocked_order_says_why_and_that_it_goes_on() -> None:
    shop = Shop()
    shop.ask(request(lines=(Line('1', 'coffee'),)))
    shop.now(task('a', '1', TaskStatus.OPEN))
    (event,) = shop.now(task('a', '1', TaskStatus.BLOCKED, reason='a pallet'))
    assert (event.status, event.reason) == (OrderStatus.BLOCKED, 'a pallet')
    assert said(shop.now(task('a', '1', TaskStatus.OPEN))) == [('', OrderStatus.PLANNED)]


@pytest.mark.parametrize(
    ('one', 'other', 'end'),
    [
        (TaskStatus.DELIVERED, TaskStatus.DELIVERED, OrderStatus.DELIVERED),
        (TaskStatus.DELIVERED, TaskStatus.FAILED, OrderStatus.PARTIAL),
        (TaskStatus.DELIVERED, TaskStatus.CANCELLED, OrderStatus.PARTIAL),
        (TaskStatus.FAILED, TaskStatus.FAILED, OrderStatus.FAILED),
        (TaskStatus.FAILED, TaskStatus.CANCELLED, OrderStatus.FAILED),
        (TaskStatus.CANCELLED, TaskStatus.CANCELLED, OrderStatus.CANCELLED),
    ],
)
def test_an_order_ends_as_its_lines_have_ended(
    one: TaskStatus, other: TaskStatus, end: OrderStatus
) -> None:
    shop = Shop()
    shop.ask(request())
    events = shop.now(task('a', '1', one), task('a', '2', other))
    assert said(events)[-1] == ('', end)
    assert {event.line_id for event in events[:-1]} == {'1', '2'}


def test_a_withdrawn_line_does_not_make_an_order_partial() -> None:
    shop = Shop()
    shop.ask(request())
    shop.ask(request(update=1, lines=(Line('1', 'coffee'),)))
    events = shop.now(task('a', '1', TaskStatus.DELIVERED), task('a', '2', TaskStatus.CANCELLED))
    assert said(events)[-1] == ('', OrderStatus.DELIVERED)
    assert events[-1].reason == '1 of 2 lines delivered, 1 of 2 lines cancelled'


def test_a_late_order_says_how_late() -> None:
    shop = Shop()
    due = datetime.fromtimestamp(10.0, UTC)
    shop.ask(request(lines=(Line('1', 'coffee'),), due_time=due))
    events = shop.now(task('a', '1', TaskStatus.DELIVERED), now_s=12.5)
    assert events[-1].late_s == 2.5
    shop.ask(request('b', lines=(Line('1', 'coffee'),), due_time=due.replace(tzinfo=None)))
    assert shop.order().due_s == 10.0


def test_the_eta_of_an_order_is_that_of_its_last_line_and_small_changes_are_no_news() -> None:
    shop = Shop()
    shop.ask(request())
    shop.assignments = Assignments(1, (Assignment('r', ('a/1',), eta_s=(30.0,)),))
    shop.now(task('a', '1', TaskStatus.ASSIGNED), task('a', '2', TaskStatus.OPEN))
    assert shop.order().eta_s is None
    shop.assignments = Assignments(2, (Assignment('r', ('a/1', 'a/2'), eta_s=(30.0, 60.0)),))
    shop.now()
    assert shop.order().eta_s == 60.0
    before = shop.desk.open()
    shop.assignments = Assignments(3, (Assignment('r', ('a/1', 'a/2'), eta_s=(31.0, 62.0)),))
    shop.now()
    assert shop.desk.open() is before
    shop.assignments = Assignments(4, (Assignment('r', ('a/1', 'a/2'), eta_s=(31.0, 65.0)),))
    shop.now()
    assert shop.order().eta_s == 65.0


# Restarts


def test_requests_that_nobody_answered_are_taken_when_the_desk_starts_again() -> None:
    desk = OrderDesk(SITE)
    (event,) = desk.restore([request()], [], now_s=7.0)
    assert (event.status, event.time_s) == (OrderStatus.RECEIVED, 7.0)
    assert len(desk.open().orders) == 1


def test_an_order_that_ended_is_not_begun_again_by_a_restart() -> None:
    end = OrderEvent('a', 0, OrderStatus.DELIVERED, 5.0)
    desk = OrderDesk(SITE)
    assert desk.restore([request()], [OrderEvent('a', 0, OrderStatus.RECEIVED, 1.0), end]) == ()
    assert desk.open().orders == ()
    assert desk.receive(request(), 9.0) == ()


def test_a_change_that_came_after_the_end_is_refused_after_a_restart_too() -> None:
    events = [
        OrderEvent('a', 0, OrderStatus.RECEIVED, 1.0),
        OrderEvent('a', 0, OrderStatus.DELIVERED, 5.0),
    ]
    desk = OrderDesk(SITE)
    (event,) = desk.restore([request(), request(update=1, priority=4)], events, now_s=9.0)
    assert event.reason == 'ORDER_ENDED: the order is DELIVERED'


def test_an_order_that_was_refused_at_a_higher_update_first_keeps_its_end() -> None:
    refused, taken = request(update=1, lines=()), request(update=0)
    events = [
        OrderEvent('a', 1, OrderStatus.REJECTED, 1.0),
        OrderEvent('a', 0, OrderStatus.RECEIVED, 2.0),
        OrderEvent('a', 0, OrderStatus.FAILED, 3.0),
    ]
    desk = OrderDesk(SITE)
    (event,) = desk.restore([refused, taken, request(update=2)], events, now_s=9.0)
    assert desk.open().orders == ()
    assert event.reason == 'ORDER_ENDED: the order is FAILED'


def test_an_order_whose_events_are_gone_goes_on_as_it_stood() -> None:
    shop = Shop()
    asked = [request(), request(update=1, priority=4)]
    shop.ask(asked[0])
    shop.ask(asked[1])
    shop.now(task('a', '1', TaskStatus.DELIVERED), task('a', '2', TaskStatus.CARRIED))
    before = shop.order()

    again = OrderDesk(SITE)
    over = request('over')
    assert again.restore([], [], past=[*asked, over], orders=[before]) == ()
    assert again.open().orders == (before,)
    assert again.receive(asked[0], 9.0) == again.receive(over, 9.0) == ()
    (event,) = again.receive(request('over', update=1), 9.0)
    assert event.reason == 'ORDER_ENDED: the order is over'
    tasks = Tasks(2, (task('a', '1', TaskStatus.DELIVERED), task('a', '2', TaskStatus.DELIVERED)))
    assert said(again.follow(tasks, None, 9.0)) == [
        ('2', OrderStatus.DELIVERED),
        ('', OrderStatus.DELIVERED),
    ]


REQUESTS = st.builds(
    lambda order, update, lines, cancel, station: OrderRequest(
        order,
        update,
        station,
        tuple(Line(line, 'rice' if line < '3' else 'salt') for line in lines),
        cancel=cancel,
    ),
    st.sampled_from('ab'),
    st.integers(0, 2),
    st.lists(st.sampled_from('123'), unique=True, max_size=3),
    st.sampled_from((False, False, False, True)),
    st.sampled_from(('packing-1', 'packing-1', 'packing-2')),
)
ACTS = st.lists(
    st.one_of(
        st.tuples(st.just('send'), REQUESTS),
        st.tuples(st.just('again'), st.integers(0, 10)),
        st.tuples(st.just('work'), st.integers(0, 100)),
        st.tuples(st.just('crash'), st.integers(0, 3)),
    ),
    max_size=30,
)


class World:
    """Kafka, a warehouse that does its work, and a desk that may die at any time."""

    def __init__(self) -> None:
        self.requests: list[OrderRequest] = []
        self.events: list[OrderEvent] = []
        self.desk = OrderDesk(SITE)
        self.tasks: dict[str, Task] = {}
        self.lost = 10**9

    def say(self, events: tuple[OrderEvent, ...]) -> None:
        for event in events:
            if self.lost == 0:
                return self.crash()
            self.lost -= 1
            self.events.append(event)
        return None

    def crash(self) -> None:
        self.lost = 10**9
        self.desk = OrderDesk(SITE)
        # Kafka holds repeats of both, after its bridge has been killed.
        requests = [*self.requests, *self.requests[-2:]]
        self.events += self.desk.restore(requests, [*self.events, *self.events[:3]])

    def work(self, chance: int) -> None:
        """Does one thing to one line, as the Task Organizer would."""
        for order in self.desk.open().orders:
            for line in order.lines:
                task_id = f'{order.order_id}/{line.line_id}'
                old = self.tasks.get(task_id)
                if old is None or old.status is TaskStatus.OPEN:
                    status = TaskStatus.OPEN
                    if order.cancelled or line.withdrawn:
                        status = TaskStatus.CANCELLED
                    self.tasks[task_id] = task(
                        order.order_id, line.line_id, status, product=line.product, quantity=1
                    )
        waiting = [it for it in self.tasks.values() if it.status is TaskStatus.OPEN]
        if waiting:
            chosen = waiting[chance % len(waiting)]
            status = TaskStatus.FAILED if chance % 7 == 0 else TaskStatus.DELIVERED
            self.tasks[chosen.task_id] = replace(chosen, status=status)
        self.say(self.desk.follow(Tasks(1, tuple(self.tasks.values())), None, 1.0))

    def finish(self) -> None:
        while self.desk.open().orders:
            self.work(1)


@settings(max_examples=300)
@given(ACTS)
def test_every_order_ends_once_wherever_the_desk_dies_and_whatever_is_repeated(
    acts: list[tuple[str, Any]],
) -> None:
    world = World()
    for act, what in acts:
        if act == 'send':
            world.requests.append(what)
            world.say(world.desk.receive(what, 1.0))
        elif act == 'again' and world.requests:
            world.say(world.desk.receive(world.requests[what % len(world.requests)], 1.0))
        elif act == 'work':
            world.work(what)
        elif act == 'crash':
            world.lost = what  # so many events are still sent
    world.finish()
    world.crash()

    names = Counter(event_name(event) for event in world.events)
    ends = {(name[0], name[2]): name[3] for name in names if name[3] in ENDS}
    times = Counter((name[0], name[2]) for name in names if name[3] in ENDS)
    assert set(times.values()) <= {1}, 'something has ended in two ways'
    for order in {name[0] for name in names if name[3] is OrderStatus.RECEIVED}:
        assert (order, '') in ends, 'an order never ended'
    for name, done in world.tasks.items():
        order, line = name.split('/')
        assert ends[order, line] == done.status.value, 'an end was not told as it was'
