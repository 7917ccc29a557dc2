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


def test_rates_and_cpu_time_are_compared_with_those_of_the_bridge() -> None:
    text = shown(result('bridge', 10.0), result('other', 30.0))
    assert 'bridge / other: 1.00 (1.00 to 1.00)' in text
    assert 'CPU time for an order, other / bridge: 3.00 (3.00 to 3.00)' in text
