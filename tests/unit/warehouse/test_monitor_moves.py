"""What the Monitor sees in how a robot moves, and what it does about that."""

import msgspec
from support.warehouse.watched import SITE, Watched, a_task, block_ahead

from ros2_kafka_warehouse.domain.monitor import Monitor
from ros2_kafka_warehouse.messages.message import node_id
from ros2_kafka_warehouse.messages.robots import FleetOrders, OrderNode, RobotOrder
from ros2_kafka_warehouse.messages.tasks import Tasks


def test_a_robot_that_does_not_begin_to_drive_has_the_cell_ahead_driven_around(
    watched: Watched,
) -> None:
    said = block_ahead(watched)
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
    block_ahead(watched)
    first = watched.report.blocked[0]
    watched.expect()
    watched.monitor.know(Tasks(1))
    watched.wait(130)
    tried_again = watched.report.blocked
    for update, (here, there) in enumerate([((0, 0), (0, 1)), ((0, 1), (0, 0))]):
        watched.order(here, there, update=50 + update)
        watched.change(last_node_id=node_id(there))
        watched.wait()
    block_ahead(watched, 100)
    second = watched.report.blocked[0]

    assert tried_again == ()
    assert second.until_s - second.since_s == 2 * (first.until_s - first.since_s)


def test_an_unblocked_cell_is_free_at_once(watched: Watched) -> None:
    block_ahead(watched)
    watched.operate('unblockCell', '', cell=(1, 0))
    watched.wait()

    assert watched.report.blocked == ()


def test_a_robot_that_stands_before_another_robot_is_not_blocked(watched: Watched) -> None:
    watched.change('b', last_node_id='1,0')
    watched.wait(10)
    watched.events.clear()

    assert [said for said in block_ahead(watched) if 'PATH' in said] == []


def test_a_robot_that_can_get_nowhere_hands_its_tasks_on_after_some_tries(
    watched: Watched,
) -> None:
    said = []
    watched.monitor.know(Tasks(1, (a_task(),)))
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


def test_a_robot_is_delayed_then_stalled_and_well_again_after_even_moves(watched: Watched) -> None:
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
