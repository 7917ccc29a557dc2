"""What the process that watches knows, and what it asks for."""

import pytest
from support.monitoring.monitors import report, snapshot

from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.history import SPAN_S, History, RouteStatistics
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.monitor import Do, RouteReport
from ros2_kafka_bridge.protocol.quantiles import percentiles
from ros2_kafka_bridge.route.counters import BOUNDS_S, Distribution, Measures

from .conftest import CONFIG, Told, configured


def counts(**found: int) -> Distribution:
    """So many in the buckets of these numbers."""
    buckets = [found.get(f'b{number}', 0) for number in range(len(BOUNDS_S) + 1)]
    return Distribution(tuple(buckets))


def test_the_answer_to_a_request_is_given_to_who_asked(told: Told) -> None:
    answer = told.watch.request(Do.PAUSE, 'orders')
    assert (answer.done, answer.text) == (True, 'pause orders')
    assert told.watch.request(Do.RELOAD).text == 'reload '
    assert [request.number for request in told.requests] == [1, 2]


def test_an_answer_that_does_not_come_is_said_to_be_missing(told: Told) -> None:
    told.answer = lambda _: None
    answer = told.watch.request(Do.PREVIEW)
    assert not answer.done
    assert 'has not answered' in answer.text


def test_who_asks_for_a_drain_waits_for_both_directions(told: Told) -> None:
    told.answer = lambda _: None
    drains = CONFIG.replace('format: text', 'format: text\n    drain_s: 0.1')
    told.tell(configured(drains))
    assert 'within 0.4 s' in told.watch.request(Do.DEACTIVATE).text


def test_at_the_end_of_the_bridge_nobody_waits(told: Told) -> None:
    told.answer = lambda _: patient.close()
    patient = Watch(told._hear, patience_s=1e6)  # which no test may take
    told.watch = patient
    told.tell(configured(CONFIG))
    assert patient.request(Do.RELOAD).text == 'the bridge has ended'
    assert patient.request(Do.RELOAD).text == 'the bridge has ended'


def test_a_new_configuration_counts_at_once(told: Told) -> None:
    assert [route.name for route in told.watch.routes] == ['orders', 'returned']
    told.tell(configured(CONFIG, 'returned'))
    assert [route.name for route in told.watch.routes] == ['returned']


def test_what_cannot_be_read_leaves_what_is_known(told: Told) -> None:
    with pytest.raises(ValueError, match='truncated'):
        told.watch.on_line(b'{"type":')
    assert told.watch.config.name == 'test'


def test_rates_come_from_the_last_seconds_and_survive_a_restart() -> None:
    history = History()
    for second in range(20):
        history.add(report(snapshot('a', confirmed=second * 50), time_s=1000.0 + second))
    assert history.recent('a').rate == pytest.approx(50)
    history.add(report(snapshot('a', confirmed=30), time_s=1020.0))
    assert history.recent('a').rate == pytest.approx(6)
    assert history.recent('nobody').rate is None


def test_a_rate_is_known_from_the_second_report_on_and_over_a_gap() -> None:
    history = History()
    history.add(report(snapshot('a', confirmed=100), time_s=1000.0))
    assert history.recent('a') == RouteStatistics()
    history.add(report(snapshot('a', confirmed=180), time_s=1008.0))
    assert history.recent('a').rate == pytest.approx(10)
    assert history.spark('a') == [(1000, None, 0), (1005, 10, 0)]


def test_who_runs_a_route_anew_has_told_no_rate() -> None:
    history = History()
    for second in range(3):
        history.add(report(snapshot('a', confirmed=second * 50), time_s=1000.0 + second))
    history.add(report(RouteReport(1, None, 0.0, snapshot('a')), time_s=1003.0))
    assert history.recent('a').rate is None
    history.add(report(snapshot('a', confirmed=20), time_s=1004.0))
    assert history.recent('a').rate is None
    history.add(report(snapshot('a', confirmed=30), time_s=1005.0))
    assert history.recent('a').rate == pytest.approx(10)


def test_spark_lines_hold_ten_minutes_in_steps() -> None:
    history = History()
    for second in range(700):
        history.add(
            report(snapshot('a', confirmed=second * 7, lag=second), time_s=1000.0 + second)
        )
    points = history.spark('a')
    assert len(points) <= SPAN_S / 5 + 1
    assert points[-1] == (1695, 7, 699)
    history.add(report(snapshot('b'), time_s=1700.0))
    assert history.spark('a') == []


def test_a_clock_that_is_set_back_makes_no_wild_rates_and_keeps_nothing_for_long() -> None:
    history = History()
    for second in range(700):
        history.add(report(snapshot('a', confirmed=second * 50), time_s=9000.0 + second))
    for second in range(700, 720):
        history.add(report(snapshot('a', confirmed=second * 50), time_s=1000.0 + second))
    assert history.recent('a').rate == pytest.approx(50)
    points = history.spark('a')
    assert [at for at, _, _ in points] == [1700, 1705, 1710, 1715]
    assert [rate for _, rate, _ in points] == [50] * 4


def test_percentiles_are_of_what_came_between() -> None:
    before, after = counts(b0=1000), counts(b0=1000, b3=98, b6=2)
    found = percentiles(after, before)
    assert found is not None
    assert 0.005 < found[0] < 0.01
    assert 0.05 < found[1] <= 0.1
    assert percentiles(after, after) is None
    # After a restart the counts begin anew.
    assert percentiles(counts(b0=4), after) == percentiles(counts(b0=4), counts())
    assert percentiles(counts(b16=5), counts()) == (300.0, 300.0)


def test_the_board_tells_only_what_has_changed() -> None:
    board, seen = Board(), dict[str, int]()
    board.put('a', [1])
    board.put('b', {'x': 'y'})
    assert board.newer(seen) == b'{"a":[1],"b":{"x":"y"}}'
    board.put('a', [1])
    assert board.newer(seen) == b''
    board.put('a', [2])
    assert board.newer(seen) == b'{"a":[2]}'
    assert board.newer({}) == b'{"a":[2],"b":{"x":"y"}}'
    board.clear()
    assert board.newer({}) == b''
    board.put('a', [2])
    assert board.newer(seen) == b'{"a":[2]}'


def test_what_was_published_and_nobody_confirms_counts_as_moving() -> None:
    history = History()
    for second in range(3):
        measures = Measures(bytes_confirmed=second * 100, bytes_published=second * 300)
        now = snapshot('a', confirmed=second * 10, published=second * 30, measures=measures)
        history.add(report(now, time_s=1000.0 + second))
    recent = history.recent('a')
    assert (recent.rate, recent.bytes_rate) == pytest.approx((40, 400))
    assert history.spark('a') == [(1000, 40, 0)]


def test_measures_are_shown_as_they_were_told() -> None:
    history = History()
    for second in range(3):
        measures = Measures(waited_s=second * 0.5, bytes_confirmed=second * 100)
        history.add(report(snapshot('a', measures=measures), time_s=1000.0 + second))
    recent = history.recent('a')
    assert recent.waited == pytest.approx(0.5)
    assert recent.bytes_rate == pytest.approx(100)
