"""In which order the Validator node hands on what it hears."""

from warehouse.messages import Tasks
from warehouse.nodes.validator import Before


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
