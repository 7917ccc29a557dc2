"""When orders wait that nobody answers, the page says so; and only then."""

from ros2_kafka_warehouse.messages.orders import (
    OpenOrders,
    Order,
    OrderEvent,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.page.intake import Intake, Standstill

NOTHING = OpenOrders()


def asked(intake: Intake, name: str, at_s: float, update: int = 0) -> None:
    intake.take_request(OrderRequest(name, update), at_s, at_s)


def answered(intake: Intake, name: str, at_s: float, update: int = 0) -> None:
    intake.take_event(OrderEvent(name, update, OrderStatus.RECEIVED, at_s), at_s)


def opened(count: int, status: OrderStatus = OrderStatus.PLANNED) -> OpenOrders:
    return OpenOrders(
        tuple(Order(f'o{number}', 0, '', (), 0.0, status=status) for number in range(count))
    )


def test_orders_that_nobody_answers_are_told_with_their_time() -> None:
    intake = Intake()
    asked(intake, 'a', 100.0)
    asked(intake, 'b', 105.0)
    assert intake.standstill(NOTHING, 109.0) is None
    assert intake.standstill(NOTHING, 111.0) == Standstill(2, 100.0)
    answered(intake, 'a', 112.0)
    assert intake.standstill(NOTHING, 121.0) is None
    assert intake.standstill(NOTHING, 123.0) == Standstill(1, 105.0)
    answered(intake, 'b', 124.0)
    assert intake.standstill(NOTHING, 200.0) is None


def test_an_answer_that_is_read_before_its_request_counts() -> None:
    intake = Intake()
    answered(intake, 'a', 100.0)
    asked(intake, 'a', 99.0)
    assert intake.standstill(NOTHING, 200.0) is None


def test_a_repeat_and_what_came_before_an_answer_wait_for_none() -> None:
    intake = Intake()
    asked(intake, 'old', 50.0)  # its answer is no longer kept
    asked(intake, 'a', 100.0)
    answered(intake, 'a', 101.0)
    asked(intake, 'a', 102.0)
    asked(intake, 'older', 40.0)
    assert intake.standstill(NOTHING, 200.0) is None


def test_another_update_wants_an_answer_of_its_own() -> None:
    intake = Intake()
    asked(intake, 'a', 100.0)
    answered(intake, 'a', 101.0)
    asked(intake, 'a', 102.0, update=1)
    assert intake.standstill(NOTHING, 113.0) == Standstill(1, 102.0)


def test_while_the_desk_is_full_orders_may_wait() -> None:
    intake = Intake()
    asked(intake, 'a', 100.0)
    assert intake.standstill(opened(200), 200.0) is None
    assert intake.standstill(NOTHING, 205.0) is None  # it has just become free
    assert intake.standstill(NOTHING, 211.0) == Standstill(1, 100.0)
    waiting = opened(200, OrderStatus.BLOCKED)  # for a person: these do not fill it
    assert intake.standstill(waiting, 212.0) is not None


def test_what_is_remembered_has_a_bound() -> None:
    intake = Intake()
    for number in range(30_000):
        asked(intake, f'w{number}', 100.0 + number)
        answered(intake, f'x{number}', 100.0)
    found = intake.standstill(NOTHING, 50_000.0)
    assert found is not None
    assert found.count == 2000
    assert len(intake._answered) <= 20_000
