"""What a browser may ask for, and what is said to the rest."""

import json
from typing import Any

import pytest

from ros2_kafka_warehouse.domain.faults import CODES
from ros2_kafka_warehouse.domain.site import Product, RobotPlace, Site
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import OrderRequest
from ros2_kafka_warehouse.page.failures import FAILURES
from ros2_kafka_warehouse.page.forms import BadForm, read_command, read_order, read_rate

SITE = Site(
    name='two aisles',
    rows=('....', '.@@.', '....'),
    stations={'packing-1': (3, 2)},
    products={'tea': Product('tea', ((1, 0),), 0.5), 'cement': Product('cement', ((2, 0),), 40.0)},
    robots={'carrier-01': RobotPlace('carrier-01', 'carrier', (0, 0))},
)


def order(**changes: Any) -> OrderRequest:
    body = {'station': 'packing-1', 'lines': [{'product': 'tea', 'quantity': 2}], **changes}
    return read_order(json.dumps(body).encode(), SITE, 'W-1', 1000.0)


def command(**body: Any) -> OperatorCommand:
    robots, failures = frozenset({'carrier-01'}), frozenset(FAILURES)
    return read_command(json.dumps(body).encode(), SITE, robots, failures, 'page-1')


def test_a_form_becomes_an_order_with_a_due_time_counted_from_now() -> None:
    request = order(priority=9, dueInS=60)
    assert (request.order_id, request.station, request.priority) == ('W-1', 'packing-1', 9)
    assert request.due_time is not None
    assert request.due_time.timestamp() == 1060.0
    [line] = request.lines
    assert (line.line_id, line.product, line.quantity) == ('L1', 'tea', 2)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'station': 'moon'}, "station: there is no 'moon'; there are packing-1"),
        ({'lines': []}, '$.lines'),
        ({'lines': [{'product': 'gold'}]}, "lines[0].product: there is no 'gold'"),
        ({'lines': [{'product': 'tea', 'quantity': 0}]}, '$.lines[0].quantity'),
        ({'lines': [{'product': 'tea', 'quantity': '2'}]}, '$.lines[0].quantity'),
        ({'lines': [{'product': 'tea'}] * 21}, '$.lines'),
        ({'priority': 10}, '$.priority'),
        ({'dueInS': -1}, '$.dueInS'),
        ({'orderId': 'mine'}, 'unknown field `orderId`'),
    ],
)
def test_an_order_that_cannot_be_is_refused_with_the_field(
    changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadForm) as refused:
        order(**changes)
    assert words in str(refused.value)


@pytest.mark.parametrize('body', [b'', b'[]', b'{', b'\xff', b'null', b'"order"'])
def test_a_body_that_is_no_form_is_refused(body: bytes) -> None:
    with pytest.raises(BadForm):
        read_order(body, SITE, 'W-1', 0.0)
    with pytest.raises(BadForm):
        read_command(body, SITE, frozenset(), frozenset(), 'page-1')
    with pytest.raises(BadForm):
        read_rate(body)


def test_a_command_names_a_robot_and_a_failure() -> None:
    assert command(
        command='failRobot', robot='carrier-01', failure='COMM_LOST'
    ) == OperatorCommand('page-1', 'failRobot', 'carrier-01', 'COMM_LOST')


def test_a_command_blocks_a_cell_known_or_not() -> None:
    assert command(command='blockCell', cell=[0, 1]) == OperatorCommand(
        'page-1', 'blockCell', cell=(0, 1)
    )
    assert command(command='blockCell', cell=[0, 1], known=True).known


def test_a_command_to_all_carries_nothing_else() -> None:
    assert command(command='pause', robot='carrier-01', cell=[0, 0]) == OperatorCommand(
        'page-1', 'pause'
    )


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ({'command': 'explode'}, "command: there is no 'explode'"),
        ({'command': 'repairRobot'}, "robot: there is no ''"),
        ({'command': 'repairRobot', 'robot': 'carrier-99'}, "there is no 'carrier-99'"),
        ({'command': 'failRobot', 'robot': 'carrier-01'}, "failure: there is no ''"),
        ({'command': 'blockCell'}, 'cell: [column, row] is missing'),
        ({'command': 'blockCell', 'cell': [1, 1]}, '1,1 is a wall or a shelf'),
        ({'command': 'blockCell', 'cell': [4, 0]}, '4,0 is not on the map'),
        ({'command': 'blockCell', 'cell': [0, -1]}, '0,-1 is not on the map'),
        ({'command': 'blockCell', 'cell': [0]}, '$.cell'),
    ],
)
def test_a_command_that_cannot_be_is_refused_with_the_field(
    body: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadForm) as refused:
        command(**body)
    assert words in str(refused.value)


def test_the_rate_of_random_orders_has_bounds() -> None:
    assert read_rate(b'{"perMinute": 12}') == 12.0
    for wrong in (b'{"perMinute": -1}', b'{"perMinute": 601}', b'{"perMinute": "1"}', b'{}'):
        with pytest.raises(BadForm):
            read_rate(wrong)


def test_every_failure_that_a_robot_can_have_can_be_chosen() -> None:
    assert set(FAILURES) == set(CODES)
