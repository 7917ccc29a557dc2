"""The tables of the latency benchmark."""

import io

from rich.console import Console

from benchmarks.experiment.results import Latency
from benchmarks.latency import Found, Measured, Started, ratios, show


def measured(number: int, contestant: str, p99: float, rate: float = 163.0) -> Measured:
    latency = Latency(5.0, 1.0, 2.0, 3.0, p99, 40.0, 50.0, ())
    return Measured(number, rate, contestant, 1000, 0, latency)


MEASURED = [
    measured(1, 'bridge', 6.0),
    measured(1, 'bare', 4.0),
    measured(2, 'bare', 10.0),
    measured(2, 'bridge', 5.0),
    measured(2, 'bare', 1.0, rate=2000.0),
]


def test_percentiles_are_divided_by_those_of_bare_loops_in_the_same_round() -> None:
    assert ratios(MEASURED, 163.0, 'bridge') == [1.5, 0.5]
    assert ratios(MEASURED, 2000.0, 'bridge') == []


def test_the_first_order_is_shown_and_start_up_apart() -> None:
    out = io.StringIO()
    found = Found(MEASURED, [Started(1, 'bridge', 2.0), Started(2, 'bridge', 4.0)])
    show(found, Console(file=out, width=80))
    text = out.getvalue()
    assert 'first' in text
    assert '99th percentile, 163 orders/s, bridge / bare: 1.00 (0.50 to 1.50)' in text
    assert '2,000 orders/s, bridge / bare' not in text
    assert 'start-up, bridge: 3.00 (2.00 to 4.00) s until' in text
