"""What a route measures: histograms, errors, and their sums over the turns of a bridge."""

import time

from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.errors import DecodeError, RouteError
from ros2_kafka_bridge.route.counters import (
    BOUNDS_S,
    MOST_TROUBLES,
    Distribution,
    Measures,
    Trouble,
)
from ros2_kafka_bridge.route.measuring import Histogram, Meter, Troubles


def counted(histogram: Histogram) -> dict[float, int]:
    """Bound -> how many, where there are any."""
    counts = histogram.distribution().counts
    return {bound: n for bound, n in zip((*BOUNDS_S, 1e9), counts, strict=True) if n}


def test_each_time_falls_into_the_first_bucket_that_holds_it() -> None:
    histogram = Histogram()
    histogram.add_since([100.0 - s for s in (0.0, 0.0009, 0.002, 0.3, 59.0, 61.0)], 100.0)
    histogram.add_since([100.0 - 301.0], 100.0)
    assert counted(histogram) == {0.001: 2, 0.0025: 1, 0.5: 1, 60.0: 1, 300.0: 1, 1e9: 1}
    assert histogram.distribution().sum_s > 301


def test_a_time_equal_to_a_bound_is_below_it() -> None:
    histogram = Histogram()
    histogram.add_since([-0.25], 0.0)
    histogram.add_since([-250], 0, 0.001)
    assert counted(histogram) == {0.25: 2}


def test_a_clock_that_is_ahead_counts_as_no_time_at_all() -> None:
    histogram = Histogram()
    histogram.add_since([2000], 1000.0, 0.001)
    assert histogram.distribution() == Distribution((1,) + (0,) * len(BOUNDS_S), 0.0)


@given(st.lists(st.integers(0, 400_000), min_size=1))
def test_a_batch_is_counted_as_if_each_had_come_alone(ages_ms: list[int]) -> None:
    together, alone = Histogram(), Histogram()
    now_ms = 1_795_000_000_000
    together.add_since([now_ms - age for age in ages_ms], now_ms, 0.001)
    for age in ages_ms:
        alone.add_since([now_ms - age], now_ms, 0.001)
    assert together.distribution().counts == alone.distribution().counts
    assert abs(together.distribution().sum_s - sum(ages_ms) / 1000) < 1e-6


def test_errors_that_differ_only_in_their_place_are_summed() -> None:
    troubles = Troubles()
    for offset in range(3):
        troubles.note(DecodeError('not JSON'), f'orders[0]@{offset}')
    troubles.note(DecodeError('not UTF-8'), 'orders[0]@9')
    measures = troubles.measures()
    assert measures.errors == {'DecodeError': 4}
    assert [(t.text, t.times) for t in measures.troubles] == [
        ('orders[0]@2: not JSON', 3),
        ('orders[0]@9: not UTF-8', 1),
    ]


def test_only_the_last_different_errors_are_kept_but_all_are_counted() -> None:
    troubles = Troubles()
    for number in range(100):
        troubles.note(RouteError(f'{number}' * 2000))
        troubles.note(RouteError('again and again'))
    measures = troubles.measures()
    assert measures.errors == {'RouteError': 200}
    assert len(measures.troubles) == MOST_TROUBLES
    assert measures.troubles[-1][1:] == ('RouteError', 'again and again', 100)
    assert max(len(t.text) for t in measures.troubles) == 1000


def test_kafka_that_is_away_is_one_error_until_it_is_back() -> None:
    meter = Meter()
    for away in ('away: no answer', 'away: no answer', 'away: wrong password', '', 'away: again'):
        meter.look(away)
    measures = meter.troubles.measures()
    assert measures.errors == {'TransportError': 2}
    assert [t.text for t in measures.troubles] == [
        'away: no answer', 'away: wrong password', 'away: again',
    ]  # fmt: skip


def test_what_was_measured_in_two_turns_is_added_and_what_is_a_state_is_not() -> None:
    now_s = time.time()
    first = Measures(
        bytes_taken=10, errors={'DecodeError': 1}, waited_s=1.5, matched=4, queued=7,
        in_bridge=Distribution((1,) * 17, 2.0), spool_bytes=3, broker_round_trip_s=(1.0, 2.0),
        troubles=(Trouble(now_s, 'DecodeError', 'bad', 2),),
    )  # fmt: skip
    second = Measures(
        bytes_taken=5, errors={'DecodeError': 1, 'RouteError': 1}, waited_s=0.5, matched=1,
        in_bridge=Distribution((2,) * 17, 1.0), published=Distribution((1,) * 17, 1.0),
        troubles=(
            Trouble(now_s - 1, 'RouteError', 'no'), Trouble(now_s + 1, 'DecodeError', 'bad'),
        ),
    )  # fmt: skip
    both = first.at_rest.plus(second)
    assert (both.bytes_taken, both.waited_s, both.matched, both.queued) == (15, 2.0, 1, None)
    assert both.errors == {'DecodeError': 2, 'RouteError': 1}
    assert both.in_bridge == Distribution((3,) * 17, 3.0)
    assert both.published == both.delay == Distribution((1,) * 17, 1.0)
    assert first.delay == first.in_bridge, 'of a route to Kafka'
    assert [(t.text, t.times) for t in both.troubles] == [('no', 1), ('bad', 3)]
    assert (first.at_rest.spool_bytes, first.at_rest.broker_round_trip_s) == (3, None)
