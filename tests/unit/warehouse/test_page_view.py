"""What the page shows, after any records in any order."""

import contextlib
import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros2_kafka_warehouse.codec import encode
from ros2_kafka_warehouse.domain.order_requests import shortened
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.monitor import (
    FailureEvent,
    FleetReport,
    OperatorCommand,
    RobotReport,
)
from ros2_kafka_warehouse.messages.onlookers import Plans, ValidatorReport, Violation
from ros2_kafka_warehouse.messages.orders import (
    Line,
    OpenOrders,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.messages.robots import (
    ErrorLevel,
    FleetState,
    Position,
    PowerSupply,
    RobotState,
)
from ros2_kafka_warehouse.page.app import new_order_id
from ros2_kafka_warehouse.page.view import View
from ros2_kafka_warehouse.topics import KAFKA

SITE = Site('small', ('....',), {'packing-1': (3, 0)}, {}, {})
NOW_S = 1000.0


def robot(column: int, name: str = 'carrier-01') -> RobotState:
    position = Position(column + 0.5, 0.5)
    return RobotState(1, name, 'carrier', f'{column},0', position, PowerSupply(50))


def put(view: View, topic: str, message: Message, now_s: float = NOW_S) -> None:
    view.take(topic, encode(message).encode(), now_s, now_s)


def look(view: View, seen: dict[str, int] | None = None) -> dict[str, Any]:
    text = view.newer({} if seen is None else seen)
    found: dict[str, Any] = json.loads(text) if text else {}
    return found


def an_order(order_id: str = 'o') -> Order:
    return Order(order_id, 0, 'packing-1', (OrderLine('L1', 'tea', 2),), 10.0)


def test_every_topic_of_the_warehouse_is_read() -> None:
    view = View(SITE)
    for topic in KAFKA:
        view.take(topic.name, b'no message', NOW_S, NOW_S)
    view.tick(NOW_S, kafka_away='', rate=0.0)
    assert look(view)['health']['unreadable'] == len(KAFKA)


def test_a_browser_gets_what_changed_since_it_looked_and_nothing_twice() -> None:
    view, seen = View(SITE), dict[str, int]()
    put(view, 'warehouse.robots', FleetState(1, (robot(1),)))
    put(view, 'warehouse.plans', Plans(1))
    assert look(view, seen).keys() == {'floor', 'plans'}
    assert look(view, seen) == {}
    put(view, 'warehouse.robots', FleetState(2, (robot(2),)))
    assert look(view, seen)['floor']['robots'][0]['x'] == 2.0
    assert look(view).keys() == {'floor', 'plans'}  # another one gets all


def test_a_robot_travels_when_it_was_elsewhere_a_step_ago() -> None:
    view = View(SITE)
    put(view, 'warehouse.robots', FleetState(1, (robot(1),)))
    put(view, 'warehouse.robots', FleetState(2, (robot(2),)))
    assert look(view)['floor']['robots'][0]['status'] == 'travelling'
    put(view, 'warehouse.robots', FleetState(2, (robot(2),)))  # the same step once more
    assert look(view)['floor']['robots'][0]['status'] == 'travelling'
    put(view, 'warehouse.robots', FleetState(3, (robot(2),)))
    assert look(view)['floor']['robots'][0]['status'] == 'idle'


def test_a_robot_that_is_heard_no_more_stays_where_the_monitor_last_saw_it() -> None:
    view = View(SITE)
    report = RobotReport('carrier-01', robot(2), 1.0, failure='COMM_LOST', level=ErrorLevel.FATAL)
    put(view, 'warehouse.fleet', FleetReport(1, (report,), halted='paused'))
    put(view, 'warehouse.robots', FleetState(2, ()))
    floor = look(view)['floor']
    assert [(row['id'], row['x'], row['status']) for row in floor['robots']] == [
        ('carrier-01', 2.0, 'silent')
    ]
    assert floor['halted'] == 'paused'


def test_an_order_that_ended_moves_to_the_ended_ones_with_its_lines() -> None:
    view = View(SITE)
    put(view, 'warehouse.open-orders', OpenOrders((an_order(),)))
    assert [row['id'] for row in look(view)['orders']['open']] == ['o']
    put(view, 'warehouse.open-orders', OpenOrders())
    put(view, 'warehouse.order-events', OrderEvent('o', 0, OrderStatus.DELIVERED, 50.0, 'L1'))
    put(view, 'warehouse.order-events', OrderEvent('o', 0, OrderStatus.DELIVERED, 50.0))
    orders = look(view)['orders']
    assert (orders['open'], orders['openCount']) == ([], 0)
    [ended] = orders['ended']
    assert (ended['status'], ended['lines'][0]['product']) == ('DELIVERED', 'tea')


def test_an_update_that_comes_too_late_does_not_change_how_an_order_ended() -> None:
    view = View(SITE)
    for update, status in ((0, 'RECEIVED'), (0, 'DELIVERED'), (1, 'REJECTED')):
        put(view, 'warehouse.order-events', OrderEvent('o', update, OrderStatus(status), 50.0))
    put(view, 'warehouse.order-events', OrderEvent('p', 0, OrderStatus.REJECTED, 50.0))
    ended = {row['id']: row['status'] for row in look(view)['orders']['ended']}
    assert ended == {'o': 'DELIVERED', 'p': 'REJECTED'}


def test_an_end_that_is_read_before_an_older_snapshot_is_not_forgotten() -> None:
    view = View(SITE)
    put(view, 'warehouse.order-events', OrderEvent('o', 0, OrderStatus.DELIVERED, 50.0))
    put(view, 'warehouse.open-orders', OpenOrders((an_order(),)))
    put(view, 'warehouse.open-orders', OpenOrders())
    orders = look(view)['orders']
    assert (orders['open'], [row['id'] for row in orders['ended']]) == ([], ['o'])


def test_an_order_that_a_higher_update_opens_anew_is_open_again() -> None:
    view = View(SITE)
    put(view, 'warehouse.order-events', OrderEvent('o', 0, OrderStatus.CANCELLED, 50.0))
    put(view, 'warehouse.open-orders', OpenOrders((an_order(),)))
    orders = look(view)['orders']
    assert ([row['id'] for row in orders['open']], orders['ended']) == (['o'], [])


def test_a_failure_that_is_told_twice_is_shown_once() -> None:
    view = View(SITE)
    seen = FailureEvent('f1', 'FailureDetected', 5.0, 'STALLED', evidence='no progress')
    for _ in range(2):
        put(view, 'warehouse.failures', seen)
    [failure] = look(view)['failures']
    assert len(failure['steps']) == 1


def test_what_a_person_has_put_on_the_floor_is_shown_before_a_robot_finds_it() -> None:
    view = View(SITE)
    put(view, 'warehouse.commands', OperatorCommand('c1', 'blockCell', cell=(2, 0)))
    assert look(view)['floor']['placed'] == [[2, 0]]
    put(view, 'warehouse.commands', OperatorCommand('c2', 'unblockCell', cell=(2, 0)))
    assert look(view)['floor']['placed'] == []


@pytest.mark.parametrize('cell', [(4, 0), (0, 1), (-1, 0), (0, -1)])
def test_a_cell_that_is_not_on_the_map_is_not_shown(cell: tuple[int, int]) -> None:
    view = View(SITE)
    put(view, 'warehouse.robots', FleetState(1))
    put(view, 'warehouse.commands', OperatorCommand('c1', 'blockCell', cell=cell))
    assert look(view)['floor']['placed'] == []


def test_a_violation_is_news_until_it_is_acknowledged_and_again_when_there_is_another() -> None:
    view = View(SITE)
    assert unseen(view, 5) == [5]
    put(view, 'warehouse.commands', OperatorCommand('c1', 'acknowledge'))
    assert unseen(view, 5) == []
    assert unseen(view, 5, 6) == [6]


def unseen(view: View, *steps: int) -> list[int]:
    """The steps of the violations that nobody has acknowledged, after a report of these."""
    broken = tuple(Violation(step, 'vertex', 'two robots on 1,0') for step in steps)
    put(view, 'warehouse.validator', ValidatorReport(steps[-1] if steps else 0, 5, broken))
    return [violation['step'] for violation in look(view)['validator']['unseen']]


def test_a_violation_is_news_though_the_list_begins_anew_or_is_full() -> None:
    view = View(SITE)
    unseen(view, 1, 2, 3)
    put(view, 'warehouse.commands', OperatorCommand('c1', 'acknowledge'))
    assert unseen(view) == []  # the validator was started again
    assert unseen(view, 9) == [9]
    unseen(view, *range(100))
    put(view, 'warehouse.commands', OperatorCommand('c2', 'acknowledge'))
    assert unseen(view, *range(1, 101)) == [100]


def test_an_acknowledgement_from_before_the_page_hides_nothing() -> None:
    view = View(SITE)
    assert unseen(view, 5) == [5]
    command = encode(OperatorCommand('c1', 'acknowledge')).encode()
    view.take('warehouse.commands', command, NOW_S, NOW_S - 60)
    assert unseen(view, 5) == [5]


def test_what_cannot_be_read_is_counted_and_changes_nothing() -> None:
    view = View(SITE)
    put(view, 'warehouse.robots', FleetState(1, (robot(1),)))
    for value in (None, b'', b'{', b'[]', b'{"step": "x"}'):
        view.take('warehouse.robots', value, NOW_S, NOW_S)
    view.tick(NOW_S, kafka_away='', rate=0)
    shown = look(view)
    assert shown['health']['unreadable'] == 5
    assert shown['floor']['step'] == 1


def test_the_age_of_what_is_shown_is_that_of_the_record() -> None:
    view = View(SITE)
    view.take('warehouse.robots', encode(FleetState(1)).encode(), NOW_S, NOW_S - 60)
    view.tick(NOW_S + 5, kafka_away='Connection refused', rate=3.0)
    health = look(view)['health']
    assert health['ages'] == {'warehouse.robots': 65.0}
    assert (health['kafkaAway'], health['rate']) == ('Connection refused', 3.0)


def test_what_is_kept_of_a_long_history_has_a_bound() -> None:
    view = View(SITE)
    for number in range(5000):
        name = f'o{number}'
        put(view, 'warehouse.order-events', OrderEvent(name, 0, OrderStatus.DELIVERED, number))
        put(view, 'warehouse.failures', FailureEvent(f'f{number}', 'FailureDetected', number))
        put(view, 'warehouse.failures', FailureEvent('f0', 'ResponseOrdered', number))
    shown = look(view)
    assert [row['id'] for row in shown['orders']['ended'][:2]] == ['o4999', 'o4998']
    assert len(shown['orders']['ended']) <= 200
    assert len(shown['failures']) <= 300
    assert len(view.newer({})) < 200_000


def test_a_huge_order_that_was_refused_is_shown_in_short() -> None:
    view, much = View(SITE), 'x' * 900_000
    lines = tuple(Line(f'{number}{much[:9000]}', much[:9000], 2**70) for number in range(50))
    for number in range(200):
        name = f'{number}{much}' if number % 50 == 0 else f'{number}'
        put(view, 'warehouse.orders', OrderRequest(name, 0, 'moon', lines, priority=2**70))
        end = OrderEvent(name, 0, OrderStatus.REJECTED, NOW_S, reason=much[:9000])
        put(view, 'warehouse.order-events', end)
    for number in range(300):
        done = OrderStatus.DELIVERED
        put(view, 'warehouse.order-events', OrderEvent('199', 0, done, NOW_S, f'{number}'))
    ended = look(view)['orders']['ended']
    assert ended[0]['id'] == '199'
    assert len(view.newer({})) < 300_000
    put(view, 'warehouse.order-events', OrderEvent(much, 0, OrderStatus.REJECTED, NOW_S))
    assert look(view)['orders']['ended'][0]['id'] == f'{much[:199]}…'


def test_a_request_and_its_cut_event_are_of_the_same_order() -> None:
    view, name = View(SITE), 'x' * 900
    put(view, 'warehouse.orders', OrderRequest(name, 0, 'packing-1', (Line('L1', 'tea'),)))
    cut = OrderEvent(shortened(name), 0, OrderStatus.REJECTED, NOW_S)
    put(view, 'warehouse.order-events', cut)
    [ended] = look(view)['orders']['ended']
    assert (ended['station'], ended['lines'][0]['product']) == ('packing-1', 'tea')


def test_a_section_that_cannot_be_shown_does_not_keep_the_others_back() -> None:
    view, seen = View(SITE), dict[str, int]()
    bad = msgspec.structs.replace(robot(1), last_node_id='nowhere')
    put(view, 'warehouse.plans', Plans(1))
    with contextlib.suppress(ValueError):  # the feed leaves such a record out
        put(view, 'warehouse.robots', FleetState(1, (bad,)))
    view._sections.change('floor')
    assert look(view, seen).keys() == {'plans'}
    put(view, 'warehouse.robots', FleetState(2, (robot(1),)))
    assert look(view, seen).keys() == {'floor'}


def test_orders_that_nobody_answers_are_a_matter_of_health() -> None:
    view = View(SITE)
    put(view, 'warehouse.orders', OrderRequest('o'))
    view.tick(NOW_S + 5, kafka_away='', rate=0)
    assert look(view)['health']['standstill'] is None
    view.tick(NOW_S + 11, kafka_away='', rate=0)
    assert look(view)['health']['standstill'] == {'count': 1, 'sinceS': NOW_S}


LIFE = (
    ('warehouse.open-orders', OpenOrders((an_order(),))),
    ('warehouse.order-events', OrderEvent('o', 0, OrderStatus.RECEIVED, 10.0)),
    ('warehouse.order-events', OrderEvent('o', 0, OrderStatus.DELIVERED, 50.0, 'L1')),
    ('warehouse.order-events', OrderEvent('o', 0, OrderStatus.DELIVERED, 50.0)),
    ('warehouse.failures', FailureEvent('f1', 'FailureDetected', 5.0)),
    ('warehouse.failures', FailureEvent('f1', 'FailureResolved', 9.0)),
    ('warehouse.robots', FleetState(3, (robot(1),))),
    ('warehouse.fleet', FleetReport(3, (RobotReport('carrier-01', robot(1), 1.0),))),
)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(LIFE), max_size=20))
def test_topics_may_be_read_in_any_order_and_repeatedly(
    records: list[tuple[str, Message]],
) -> None:
    view, seen, shown = View(SITE), dict[str, int](), dict[str, Any]()
    for topic, message in records:
        put(view, topic, message)
        shown.update(look(view, seen))
    view.tick(NOW_S, kafka_away='', rate=0)
    shown.update(look(view, seen))
    assert shown == look(view)


def test_no_two_orders_of_pages_have_the_same_name() -> None:
    assert len({new_order_id() for _ in range(20_000)}) == 20_000
