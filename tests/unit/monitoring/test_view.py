"""What `/api/state` and `/api/history` tell while not all is known."""

from typing import Any

from support.monitoring.monitors import report, snapshot

from ros2_kafka_bridge.monitoring import view
from ros2_kafka_bridge.protocol.monitor import Report, RouteReport
from ros2_kafka_bridge.route.counters import Measures, State

from .conftest import Told


def routes(told: Told, *reports: Report) -> list[dict[str, Any]]:
    for it in reports:
        told.tell(it)
    return view.routes(told.watch)


def test_before_the_first_report_nobody_knows_what_the_bridge_does() -> None:
    bridge = view.bridge(Told().watch)
    assert (bridge['lifecycle'], bridge['stopping']) == (None, None)


def test_of_one_report_alone_no_rate_is_told() -> None:
    told, now = Told(), snapshot('orders', confirmed=70)
    [first] = routes(told, report(now, time_s=1000.0))
    assert (first['rate'], first['bytes_rate'], first['waited']) == (None, None, None)
    [second] = routes(told, report(now, time_s=1001.0))
    assert (second['rate'], second['bytes_rate'], second['waited']) == (0, 0, 0)


def test_what_a_route_does_not_know_is_null() -> None:
    [found] = routes(Told(), report(snapshot('returned', spooled=None, measures=Measures())))
    unknown = ('spooled', 'spool_bytes', 'matched', 'mismatched', 'queued', 'queue_limit', 'lag')
    assert {name: found[name] for name in unknown} == dict.fromkeys(unknown)
    assert (found['in_flight'], found['ended']['confirmed']) == (0, 0)


def test_what_was_published_is_shown_and_not_among_what_is_confirmed() -> None:
    measures = Measures(bytes_confirmed=40, bytes_published=700)
    now = snapshot('orders', taken=9, confirmed=2, published=7, measures=measures)
    [found] = routes(Told(), report(now))
    assert (found['ended']['confirmed'], found['ended']['published']) == (2, 7)
    assert (found['bytes_confirmed'], found['bytes_published']) == (40, 700)


def test_a_route_that_has_told_nothing_has_no_numbers() -> None:
    silent = RouteReport(1, None, 0.0, snapshot('orders', State.STARTING, spooled=None))
    told = Told()
    [found] = routes(told, *(report(silent, time_s=1000.0 + second) for second in range(3)))
    assert found['state'] == 'starting'
    counted = ('age_s', 'rate', 'taken', 'in_flight', 'spooled', 'bytes_confirmed')
    assert {name: found[name] for name in counted} == dict.fromkeys(counted)
    assert set(found['ended'].values()) == {None}
    assert view.sparks(told.watch)['orders'] == []


def test_a_reader_holds_nothing_that_is_known_before_its_first_lag() -> None:
    told = Told()
    for second, lag in enumerate((None, None, 9, None)):
        told.tell(report(snapshot('orders', in_flight=4, lag=lag), time_s=1000.0 + 5 * second))
    found = view.sparks(told.watch)['orders']
    assert [held for _, _, held in found] == [None, None, 9, None]
    assert [rate for _, rate, _ in found] == [None, 0, 0, 0]


def test_what_a_route_holds_is_not_known_before_its_disk_is() -> None:
    told = Told()
    for second, spooled in enumerate((None, 3)):
        returned = snapshot('returned', in_flight=1, spooled=spooled)
        told.tell(report(returned, time_s=1000.0 + 5 * second))
    assert [held for _, _, held in view.sparks(told.watch)['returned']] == [None, 4]
