"""The desk takes each order once, whatever is repeated, and every order ends once."""

from collections import Counter
from datetime import UTC, datetime
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from warehouse.codec import encode
from warehouse.domain.execution_profiles import read_execution_profiles
from warehouse.domain.orders import OrderDesk, event_name
from warehouse.domain.random_orders import random_order
from warehouse.domain.site import make_site, read_site
from warehouse.messages import (
    Assignment,
    Assignments,
    Line,
    LineStatus,
    Order,
    OrderEvent,
    OrderRequest,
    OrderStatus,
    Task,
    Tasks,
    TaskStatus,
)

SITE = read_site()
ENDS = {OrderStatus.DELIVERED, OrderStatus.PARTIAL, OrderStatus.FAILED, OrderStatus.CANCELLED}


def request(order_id: str = 'a', update: int = 0, **more: Any) -> OrderRequest:
    more.setdefault('lines', (Line('1', 'coffee'), Line('2', 'rice', 2)))
    return OrderRequest(order_id, update, more.pop('station', 'packing-1'), **more)


def task(order: str, line: str, status: TaskStatus, **more: Any) -> Task:
    more.setdefault('product', 'coffee' if line == '1' else 'rice')
    more.setdefault('quantity', 1 if line == '1' else 2)
    more.setdefault('carried', status is TaskStatus.CARRIED)
    return Task(
        task_id=f'{order}/{line}',
        order_id=order,
        line_id=line,
        weight_kg=1.0,
        pickup=(5, 1),
        delivery=(41, 2),
        released_s=0.0,
        status=status,
        **more,
    )


def said(events: tuple[OrderEvent, ...]) -> list[tuple[str, OrderStatus]]:
    return [(event.line_id, event.status) for event in events]


class Shop:
    """A desk, and the tasks that its orders have become."""

    def __init__(self) -> None:
        self.desk = OrderDesk(SITE)
        self.tasks: dict[str, Task] = {}
        self.assignments: Assignments | None = None

    def ask(self, asked: OrderRequest, now_s: float = 1.0) -> list[tuple[str, OrderStatus]]:
        return said(self.desk.receive(asked, now_s))

    def now(self, *tasks: Task, now_s: float = 2.0) -> tuple[OrderEvent, ...]:
        self.tasks |= {it.task_id: it for it in tasks}
        snapshot = Tasks(1, tuple(self.tasks.values()))
        return self.desk.follow(snapshot, self.assignments, now_s)

    def order(self) -> Order:
        (order,) = self.desk.open().orders
        return order


# Requests


def test_a_new_order_is_received_once_however_often_it_comes() -> None:
    shop = Shop()
    assert shop.ask(request()) == [('', OrderStatus.RECEIVED)]
    assert shop.ask(request()) == []
    assert [line.line_id for line in shop.order().lines] == ['1', '2']
    assert shop.order().released_s == 1.0


@pytest.mark.parametrize(
    ('asked', 'reason'),
    [
        (request(lines=()), 'at least one line'),
        (request(lines=(Line('1', 'gold'),)), "line 1: no product is called 'gold'"),
        (request(station='moon'), "no station is called 'moon'; there are packing-1, packing-2"),
        (request(lines=(Line('1', 'rice', 0),)), 'line 1: quantity must be from 1 to 10000'),
        (request(lines=(Line('1', 'rice', 10**309),)), 'line 1: quantity must be from 1'),
        (request(lines=(Line('1', 'rice'), Line('1', 'tape'))), 'the same lineId'),
        (request(lines=(Line('a/b', 'rice'),)), "no '/'"),
        (request(priority=10), 'priority is 10; it goes from 0 to 9'),
        (request(lines=tuple(Line(str(n), 'rice') for n in range(101))), 'at most 100'),
        (request(cancel=True), 'NO_ORDER_TO_CANCEL'),
    ],
)
def test_an_order_that_cannot_be_is_rejected_with_the_reason(
    asked: OrderRequest, reason: str
) -> None:
    desk = OrderDesk(SITE)
    (event,) = desk.receive(asked, 1.0)
    assert event.status is OrderStatus.REJECTED
    assert reason in event.reason
    assert desk.receive(asked, 2.0) == ()
    assert desk.open().orders == ()


@pytest.mark.parametrize(
    ('asked', 'reason'),
    [
        (request(order_id=''), 'orderId must have 1 to 200 characters'),
        (request(order_id='x' * 201), 'orderId must have 1 to 200 characters'),
        (request(update=-1), 'orderUpdateId goes from 0 to 4294967295'),
        (request(update=2**32), 'orderUpdateId goes from 0 to 4294967295'),
        (request(update=-1, cancel=True), 'orderUpdateId goes from 0'),
    ],
)
def test_a_request_that_names_no_order_is_rejected_and_nothing_is_kept_of_it(
    asked: OrderRequest, reason: str
) -> None:
    desk = OrderDesk(SITE)
    (event,) = desk.receive(asked, 1.0)
    assert event.status is OrderStatus.REJECTED
    assert reason in event.reason
    assert desk.receive(asked, 1.0) == (event,), 'it is answered anew: nothing is kept of it'
    again = OrderDesk(SITE)
    assert again.restore([asked], [event], past=[asked]) == ()
    assert again.open().orders == ()


@pytest.mark.parametrize('what', [{'order_id': 'x' * 900_000}, {'station': 'x' * 900_000}])
def test_a_refused_text_is_not_repeated_to_all_who_look_on(what: dict[str, str]) -> None:
    asked = replace(request(), **what)
    (event,) = OrderDesk(SITE).receive(asked, 1.0)
    assert event.status is OrderStatus.REJECTED
    assert len(encode(event)) < 1000


@pytest.mark.parametrize(
    ('asked', 'reason'),
    [
        (request(update=4), 'OUTDATED_ORDER_UPDATE'),
        (request(update=5, priority=3), 'SAME_ORDER_UPDATE_ID'),
        (request(update=6, station='moon'), 'VALIDATION_FAILURE'),
    ],
)
def test_a_change_that_does_not_fit_is_rejected_and_the_order_goes_on(
    asked: OrderRequest, reason: str
) -> None:
    desk = OrderDesk(SITE)
    desk.receive(request(update=5), 1.0)
    before = desk.open()
    (event,) = desk.receive(asked, 2.0)
    assert (event.status, event.order_update_id) == (OrderStatus.REJECTED, asked.order_update_id)
    assert event.reason.startswith(reason)
    assert desk.open() == before


def test_an_earlier_update_that_is_delivered_again_is_a_repeat_and_no_mistake() -> None:
    shop = Shop()
    shop.ask(request())
    shop.ask(request(update=1, priority=5))
    assert shop.ask(request()) == []
    assert shop.order().priority == 5


def test_an_order_that_was_rejected_may_come_again_corrected() -> None:
    shop = Shop()
    shop.ask(request(station='moon'))
    assert shop.ask(request(update=1)) == [('', OrderStatus.RECEIVED)]


def test_a_change_replaces_lines_that_have_not_ended_and_withdraws_the_others() -> None:
    shop = Shop()
    shop.ask(request(lines=(Line('1', 'coffee'), Line('2', 'rice', 2), Line('3', 'tape'))))
    shop.now(task('a', '1', TaskStatus.DELIVERED))
    changed = (Line('1', 'cocoa'), Line('2', 'salt'), Line('4', 'soap'))
    assert shop.ask(request(update=1, lines=changed)) == [('', OrderStatus.RECEIVED)]
    lines = {line.line_id: line for line in shop.order().lines}
    assert (lines['1'].product, lines['1'].status) == ('coffee', LineStatus.DELIVERED)
    assert (lines['2'].product, lines['2'].quantity) == ('salt', 1)
    assert lines['3'].withdrawn
    assert lines['4'].product == 'soap'


def test_a_change_that_comes_after_the_pick_changes_nothing() -> None:
    shop = Shop()
    shop.ask(request(lines=(Line('2', 'rice', 2),)))
    shop.ask(request(update=1, lines=(Line('2', 'salt'),)))
    shop.now(task('a', '2', TaskStatus.CARRIED))
    assert (shop.order().lines[0].product, shop.order().lines[0].quantity) == ('rice', 2)


def test_a_new_station_is_refused_once_a_robot_picks_and_after_a_restart_too() -> None:
    shop = Shop()
    asked = [request(), request(update=1, station='packing-2')]
    events = [*shop.desk.receive(asked[0], 1.0)]
    assert said(shop.desk.receive(asked[1], 1.0)) == [('', OrderStatus.RECEIVED)]
    assert shop.order().station == 'packing-2'
    events.append(OrderEvent('a', 1, OrderStatus.RECEIVED, 1.0))
    events += shop.now(task('a', '1', TaskStatus.PICKING), task('a', '2', TaskStatus.OPEN))
    asked.append(request(update=2))
    (refused,) = shop.desk.receive(asked[2], 3.0)
    assert refused.status is OrderStatus.REJECTED
    assert "the station is still 'packing-2'" in refused.reason
    assert shop.order().station == 'packing-2'

    again = OrderDesk(SITE)
    assert again.restore(asked, [*events, refused]) == ()
    assert again.open().orders[0].station == 'packing-2'


@pytest.mark.parametrize('status', [TaskStatus.OPEN, TaskStatus.CANCELLED])
def test_a_line_that_was_withdrawn_is_not_taken_again_in_silence(status: TaskStatus) -> None:
    shop = Shop()
    shop.ask(request())
    shop.ask(request(update=1, lines=(Line('1', 'coffee'),)))
    shop.now(task('a', '1', TaskStatus.OPEN), task('a', '2', status))
    (event,) = shop.desk.receive(request(update=2), 3.0)
    assert event.status is OrderStatus.REJECTED
    assert event.reason.endswith(
        'line 2 was withdrawn by an earlier update: give it another lineId'
    )
    renamed = (Line('1', 'coffee'), Line('3', 'rice', 2))
    assert shop.ask(request(update=2, lines=renamed, priority=1)) == [('', OrderStatus.RECEIVED)]


def test_an_order_that_ended_takes_no_change() -> None:
    shop = Shop()
    shop.ask(request(lines=(Line('1', 'coffee'),)))
    shop.now(task('a', '1', TaskStatus.DELIVERED))
    (event,) = shop.desk.receive(request(update=1), 3.0)
    assert event.reason == 'ORDER_ENDED: the order is DELIVERED'


def test_an_order_that_comes_after_its_cancelling_is_not_begun() -> None:
    shop = Shop()
    shop.ask(request(update=1, cancel=True))
    assert shop.ask(request()) == [('', OrderStatus.REJECTED)]
    assert shop.desk.open().orders == ()


def test_a_full_desk_says_so() -> None:
    desk = OrderDesk(SITE, max_open=2)
    desk.receive(request('a'), 1.0)
    assert not desk.is_full
    desk.receive(request('b'), 1.0)
    assert desk.is_full


def test_orders_that_wait_for_a_person_do_not_fill_the_desk_until_there_are_very_many() -> None:
    shop = Shop()
    shop.desk = OrderDesk(SITE, max_open=2)
    for number in range(10):
        assert not shop.desk.is_full
        name = f'stuck-{number}'
        shop.ask(request(name))
        shop.now(*(task(name, line, TaskStatus.BLOCKED) for line in '12'))
    assert shop.desk.is_full

    shop.now(task('stuck-0', '1', TaskStatus.DELIVERED), task('stuck-0', '2', TaskStatus.FAILED))
    assert not shop.desk.is_full
    shop.now(task('stuck-1', '1', TaskStatus.OPEN))
    assert not shop.desk.is_full
    shop.now(task('stuck-2', '2', TaskStatus.CARRIED))
    assert shop.desk.is_full


def test_ids_that_are_over_are_forgotten_the_oldest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('warehouse.domain.orders._ENDED_KEPT', 3)
    shop = Shop()
    shop.ask(request('open'))
    refused = [request(f'no-{number}', station='moon') for number in range(5)]
    for asked in refused:
        shop.ask(asked)
    assert [len(shop.ask(asked)) for asked in refused[2:]] == [0, 0, 0]
    assert len(shop.ask(refused[0])) == 1, 'known for ever'
    assert shop.ask(request('open')) == []


def test_random_orders_ask_only_for_what_robots_of_this_site_carry() -> None:
    site, profiles = make_site(2), read_execution_profiles()
    types = {profiles.robot_types[robot.robot_type] for robot in site.robots.values()}
    assert len(types) < len(profiles.robot_types), 'a site that lacks a type'
    random = Random(1)  # noqa: S311 (orders, no secrets)
    for number in range(300):
        for line in random_order(site, random, str(number), 0.0, profiles).lines:
            product = site.products[line.product]
            kg = line.quantity * product.weight_kg
            assert any(kg <= kind.max_load_kg and product.size in kind.sizes for kind in types)


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
