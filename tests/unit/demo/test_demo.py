"""What the demonstration counts and draws, by cases worked out by hand."""

import io
import tempfile
from collections.abc import Sequence

import pytest
from rich.console import Console

from ros2_kafka_bridge.demo.run import DemoOptions, losses, run
from ros2_kafka_bridge.demo.table import Look, line, page, spark, summary
from ros2_kafka_bridge.demo.tally import Arrival, Latency, Tally, percentile
from ros2_kafka_bridge.errors import ConfigError, TransportError

LOOK = Look(
    phase='done',
    rate=160.4,
    seconds=600.0,
    produced=95_664,
    kafka_to_ros=95_664,
    ros_to_kafka=92_195,
    consumed=92_195,
    lost=3_469,
    deleted=0,
    duplicated=0,
    latency=Latency(0.006247, 0.0125, 0.25, 1.107546),
    rates=(160, 80, 0),
    final=True,
)


def arrivals(*order_ids: int, at_s: float = 0.0) -> list[Arrival]:
    return [Arrival(order_id, at_s, 0.01) for order_id in order_ids]


# Tally


def test_an_order_that_comes_twice_is_consumed_once_and_duplicated_once() -> None:
    tally = Tally()
    tally.add(arrivals(0, 1, 1))
    tally.add(arrivals(0))
    assert (tally.consumed, tally.duplicated) == (2, 2)


def test_lost_are_those_produced_that_never_came_the_last_ones_too() -> None:
    tally = Tally()
    tally.add(arrivals(0, 1, 3))
    assert tally.lost(6) == 3


def test_a_duplicate_does_not_stand_for_one_that_is_lost() -> None:
    tally = Tally()
    tally.add(arrivals(0, 0, 2))
    assert (tally.lost(3), tally.duplicated) == (1, 1)


def test_an_order_that_was_overtaken_is_missed_after_a_second_and_no_more_once_it_came() -> None:
    tally = Tally()
    tally.add(arrivals(0, 3, at_s=5.0))
    assert tally.overdue(5.9) == 0
    assert tally.overdue(6.1) == 2
    tally.add(arrivals(2, at_s=6.2))
    assert tally.overdue(7.0) == 1


def test_latencies_are_by_nearest_rank_whatever_the_order_they_come_in() -> None:
    tally = Tally()
    assert tally.latency() is None
    for first in (101, 1):
        tally.add([Arrival(n, 0.0, n / 1000) for n in range(first, first + 100)])
    assert tally.latency() == Latency(0.001, 0.100, 0.198, 0.200)


@pytest.mark.parametrize(
    ('values', 'percent', 'expected'),
    [([7.0], 50, 7.0), ([7.0], 99, 7.0), ([1.0, 2.0], 50, 1.0), ([1.0, 2.0, 3.0], 50, 2.0)],
)
def test_a_percentile_is_one_of_the_values(
    values: list[float], percent: float, expected: float
) -> None:
    assert percentile(values, percent) == expected


def test_rates_are_per_second_since_the_first_arrival_and_only_of_seconds_that_passed() -> None:
    tally = Tally()
    assert tally.rates(3.0) == []
    tally.add([*arrivals(0, 1, at_s=0.5), *arrivals(2, at_s=1.6), *arrivals(3, at_s=3.6)])
    assert tally.rates(3.7) == [2, 1, 0]
    assert tally.rates(6.5) == [2, 1, 0, 1, 0, 0]
    assert tally.rates() == [2, 1, 0, 1]


# Spark line


@pytest.mark.parametrize(
    ('values', 'width', 'expected'),
    [
        ([], 10, ''),
        ([0, 0], 10, '▁▁'),
        ([5, 5, 5], 10, '███'),
        ([0, 1, 2, 3, 4, 5, 6, 7], 8, '▁▂▃▄▅▆▇█'),
        ([0, 0, 7, 7, 2, 4], 3, '▁█▄'),
    ],
)
def test_a_spark_line_reaches_from_zero_to_the_highest(
    values: list[float], width: int, expected: str
) -> None:
    assert spark(values, width) == expected


def test_a_long_run_is_drawn_in_the_width_there_is() -> None:
    assert len(spark(list(range(1000)), 24)) == 24


# What is shown


def test_the_last_line_has_the_columns_of_the_paper() -> None:
    assert summary(LOOK) == (
        'bridge: Producer 95,664, Kafka-ROS 95,664, ROS-Kafka 92,195, Consumer 92,195, '
        'lost 3,469 (3.63 %), fastest 0.006247 s, slowest 1.107546 s'
    )


def test_the_last_line_does_not_invent_what_is_not_known() -> None:
    nothing = LOOK._replace(produced=3, kafka_to_ros=None, consumed=0, lost=3, latency=None)
    assert summary(nothing) == (
        'bridge: Producer 3, Kafka-ROS -, ROS-Kafka 92,195, Consumer 0, lost 3 (100.00 %)'
    )


@pytest.mark.parametrize(('rates', 'drawn'), [((160, 80, 0), '█▅▁'), ((1,) * 1000, '█' * 24)])
def test_the_table_fits_into_eighty_columns(rates: Sequence[int], drawn: str) -> None:
    out = io.StringIO()
    look = LOOK._replace(final=False, rates=rates)
    Console(file=out, width=80).print(page('1,000 orders', look))
    shown = out.getvalue()
    assert max(map(len, shown.splitlines())) <= 80
    assert '…' not in shown
    for cell in ('3,469 (3.63 %)', '6.2 ms', '12.5 ms', '250.0 ms', '1,107.5 ms', drawn, '160'):
        assert cell in shown


def test_a_plain_line_tells_the_same_without_control_characters() -> None:
    assert line(LOOK) == (
        'this bridge: done, 600 s, 160 sent a second, produced 95,664, '
        'Kafka -> ROS 95,664, ROS -> Kafka 92,195, consumed 92,195, lost 3,469 (3.63 %), '
        'duplicated 0, latency 6.2 / 12.5 / 250.0 / 1107.5 ms'
    )


def test_a_plain_line_tells_what_was_sent_also_where_nothing_has_come_back() -> None:
    stuck = line(LOOK._replace(phase='sending', seconds=7.0, latency=None, consumed=0))
    assert 'sending, 7 s, 160 sent a second, produced 95,664, Kafka -> ROS 95,664' in stuck
    assert 'latency' not in stuck
    assert line(LOOK._replace(phase='starting', seconds=0.0)) == 'this bridge: starting'


# What is blamed on whom


@pytest.mark.parametrize(
    ('deleted', 'expected'),
    [
        (0, ['the bridge has lost 3,469 orders']),
        (3_000, ['the broker deleted 3,000 orders', 'the bridge has lost 469 orders']),
        (3_469, ['the broker deleted 3,469 orders']),
        (3_500, ['the broker deleted 3,469 orders']),
    ],
)
def test_what_the_broker_deleted_is_not_blamed_on_the_bridge(
    deleted: int, expected: list[str]
) -> None:
    found = losses(LOOK._replace(deleted=deleted))
    assert [text.partition(' before')[0] for text in found] == expected


# Options


@pytest.mark.parametrize(
    ('options', 'problem'),
    [
        (DemoOptions(rate=0), '--rate 0: expected more than 0, at most 1,000'),
        (DemoOptions(rate=float('nan')), '--rate nan: expected'),
        (DemoOptions(rate=1_001), '--bootstrap-servers takes more'),
        (
            DemoOptions(rate=20_000, bootstrap_servers='there:9092'),
            'at most 10,000 orders a second$',
        ),
        (DemoOptions(seconds=-1), '--seconds -1: expected a number of seconds, more than 0'),
        (DemoOptions(seconds=float('inf')), '--seconds inf: expected a number of seconds'),
        (DemoOptions(bootstrap_servers=''), '-servers: names no broker: .* leave it out for'),
        (DemoOptions(domain=233), '--domain 233: expected 0 to 232'),
    ],
)
def test_an_option_that_cannot_be_is_refused_in_a_sentence(
    options: DemoOptions, problem: str
) -> None:
    with pytest.raises(ConfigError, match=problem):
        run(options)


def test_without_a_folder_for_temporary_files_the_cure_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', '/proc/none')
    with pytest.raises(TransportError, match='set TMPDIR to one'):
        run(DemoOptions(rate=1, seconds=1))


def test_without_ros_nothing_begins_and_one_sentence_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.outside.extras.find_spec', lambda _: None)
    with pytest.raises(ConfigError) as caught:
        run(DemoOptions(seconds=0.1))
    [problem] = caught.value.problems
    assert problem.startswith("ROS 2 is not here (No module named 'rclpy'): ")
    assert '[ros]' in problem or 'ros-rclpy' in problem
