"""The desk takes each request once, and refuses what cannot be."""

from random import Random

import pytest
from msgspec.structs import replace
from support.bridges.shop import SITE, Shop, request, said, task

from ros2_kafka_warehouse.codec import encode
from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.orders import OrderDesk
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.site import make_site
from ros2_kafka_warehouse.messages.orders import (
    Line,
    LineStatus,
    OrderEvent,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.tasks import TaskStatus


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
    monkeypatch.setattr('ros2_kafka_warehouse.domain.orders._ENDED_KEPT', 3)
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
