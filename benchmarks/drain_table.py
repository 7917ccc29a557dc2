"""What the contestants of a drain did, as a table and as JSON."""

import argparse
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table


class Side(NamedTuple):
    """What one process has used.

    Args:
        cpu_us: Microseconds of CPU time per delivered order.
        anon_mib: Most anonymous memory seen.
    """

    cpu_us: float
    anon_mib: float


class Result(NamedTuple):
    """What one contestant did in one round.

    Args:
        start_s: From the start of the process that publishes until the first order was through.
        seconds: From there until the last one was.
    """

    contestant: str
    round: int
    orders: int
    delivered: int
    duplicated: int
    out_of_order: int
    start_s: float
    seconds: float
    kafka_to_ros: Side
    ros_to_kafka: Side

    @property
    def lost(self) -> int:
        """Orders that never arrived."""
        return self.orders - self.delivered

    @property
    def cpu_us(self) -> float:
        """Microseconds of CPU time per delivered order, in both directions."""
        return self.kafka_to_ros.cpu_us + self.ros_to_kafka.cpu_us

    @property
    def rate(self) -> float:
        """Orders delivered per second."""
        return self.delivered / self.seconds


def show(results: Sequence[Result], console: Console) -> None:
    """Print the table of medians, and the ratios."""
    by_name = _by_contestant(results)
    most = max(len(of_one) for of_one in by_name.values())
    title = f'{results[0].orders:,} orders, ' + (
        'one round' if most == 1 else f'medians of {most}'
    )
    table = Table(title=title)
    table.add_column('')
    for name in by_name:
        table.add_column(name, justify='right')
    for words, read, form in _ROWS:
        table.add_row(words, *(form(map(read, of_one)) for of_one in by_name.values()))
    console.print(table)
    for words, ratios in _ratios(by_name).items():
        low, high = min(ratios), max(ratios)
        console.print(f'{words}: {statistics.median(ratios):.2f} ({low:.2f} to {high:.2f})')


def _by_contestant(results: Sequence[Result]) -> dict[str, list[Result]]:
    by_name: dict[str, list[Result]] = {}
    for result in results:
        by_name.setdefault(result.contestant, []).append(result)
    return by_name


def _ratios(by_name: dict[str, list[Result]]) -> dict[str, list[float]]:
    """Rates of the bridge, and its CPU time for an order, by those of another in that round."""
    bridge = by_name.get('bridge', [])
    return {
        f'{words}bridge / {name}': [
            read(one) / read(two) for one, two in zip(bridge, of_one, strict=True)
        ]
        for words, read in _COMPARED
        for name, of_one in by_name.items()
        if bridge and name != 'bridge'
    }


def _whole(values: Iterator[float]) -> str:
    return f'{statistics.median(values):,.0f}'


def _tenths(values: Iterator[float]) -> str:
    return f'{statistics.median(values):,.1f}'


_ROWS: Final[Sequence[tuple[str, Callable[[Result], float], Callable[[Iterator[float]], str]]]] = (
    ('orders/s delivered', lambda r: r.rate, _whole),
    ('seconds', lambda r: r.seconds, _tenths),
    ('seconds of start-up before', lambda r: r.start_s, _tenths),
    ('delivered', lambda r: r.delivered, _whole),
    ('lost', lambda r: r.lost, _whole),
    ('duplicated', lambda r: r.duplicated, _whole),
    ('out of order', lambda r: r.out_of_order, _whole),
    ('CPU µs/order, Kafka -> ROS', lambda r: r.kafka_to_ros.cpu_us, _tenths),
    ('CPU µs/order, ROS -> Kafka', lambda r: r.ros_to_kafka.cpu_us, _tenths),
    ('RssAnon MiB, Kafka -> ROS', lambda r: r.kafka_to_ros.anon_mib, _tenths),
    ('RssAnon MiB, ROS -> Kafka', lambda r: r.ros_to_kafka.anon_mib, _tenths),
)

_COMPARED: Final[Sequence[tuple[str, Callable[[Result], float]]]] = (
    ('', lambda r: r.rate),
    ('CPU time for an order, ', lambda r: r.cpu_us),
)


def report(results: Sequence[Result], _: argparse.Namespace) -> Mapping[str, Any]:
    """Make what `--json` writes."""
    rounds = [
        {
            **result._asdict(),
            'lost': result.lost,
            'orders_per_s': result.rate,
            'kafka_to_ros': result.kafka_to_ros._asdict(),
            'ros_to_kafka': result.ros_to_kafka._asdict(),
        }
        for result in results
    ]
    return {'ratios': _ratios(_by_contestant(results)), 'rounds': rounds}
