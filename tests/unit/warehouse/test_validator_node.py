"""In which order the Validator node hands on what it hears, and what it writes to its log."""

from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.tasks import Tasks
from ros2_kafka_warehouse.nodes.validator import Before, new_ones


def test_a_state_is_checked_with_what_was_said_of_the_steps_before() -> None:
    tasks: Before[Tasks] = Before()
    tasks.add([Tasks(3), Tasks(4), Tasks(4), Tasks(5)])
    assert tasks.is_complete(5)
    assert not tasks.is_complete(6)
    assert [one.step for one in tasks.take(5)] == [3, 4, 4]
    assert tasks.take(5) == []
    tasks.add([Tasks(6)])
    assert [one.step for one in tasks.take(6)] == [5]
    assert tasks.is_complete(6)


def test_only_violations_that_were_not_there_before_are_new() -> None:
    one, two, three = (Violation(step, 'swap', 'at (0, 0) and (1, 0)') for step in range(3))
    nothing, before = ValidatorReport(0, 0), ValidatorReport(1, 1, (one, two))
    assert new_ones(before, nothing) == [one, two]
    assert new_ones(before, before) == []
    # The oldest are dropped from a long report.
    assert new_ones(ValidatorReport(2, 2, (two, three)), before) == [three]
