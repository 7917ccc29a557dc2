"""What counts as live traffic when `depth` listens to a ROS topic."""

import pytest

from ros2_kafka_bridge.commands.depth_sources import Heard, live

S = 1_000_000_000


@pytest.mark.parametrize('ahead_s', [0, 1_700_000_000, -3600])
def test_live_messages_count_whatever_the_clock_of_their_publisher_says(ahead_s: int) -> None:
    source_ns = [(100 + number) * S for number in range(5)]
    heard = [Heard(b'a', at_ns + ahead_s * S, at_ns + 1000) for at_ns in source_ns]
    assert live(heard) == [at_ns + ahead_s * S for at_ns in source_ns]


def test_what_a_latched_publisher_had_said_before_does_not_count() -> None:
    said_before = [Heard(b'a', at_s * S, 100 * S) for at_s in (1, 50, 98)]
    heard = [*said_before, Heard(b'a', 101 * S, 101 * S + 1000), Heard(b'b', 7 * S, 102 * S)]
    assert live(heard) == [101 * S, 7 * S]
