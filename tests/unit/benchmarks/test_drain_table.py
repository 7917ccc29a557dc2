"""The table of the drain benchmark."""

import io

from rich.console import Console

from benchmarks.drain_table import Result, Side, show


def result(contestant: str, cpu_us: float) -> Result:
    side = Side(cpu_us, 40.0)
    return Result(contestant, 1, 1000, 1000, 0, 0, 1.5, 0.5, side, side)


def shown(*results: Result) -> str:
    out = io.StringIO()
    show(results, Console(file=out, width=120))
    return out.getvalue()


def test_rates_and_cpu_time_of_the_bridge_are_compared_with_those_of_another() -> None:
    text = shown(result('bridge', 10.0), result('other', 30.0))
    assert 'bridge / other: 1.00 (1.00 to 1.00)' in text
    assert 'CPU time for an order, bridge / other: 0.33 (0.33 to 0.33)' in text
