"""What a person sees: a table that lives in a terminal, or plain lines."""

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from statistics import fmean
from typing import Final, NamedTuple, TypeVar

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from ros2_kafka_bridge.demo.tally import Latency

_REFRESH_S: Final = 0.25
_LINE_S: Final = 1.0
_SPARK_WIDTH: Final = 24
_BARS: Final = '▁▂▃▄▅▆▇█'
_WHO: Final = 'this bridge'
_HINT: Final = 'Kafka -> ROS, ROS -> Kafka: as told once a second. Ctrl-C: stop and count.'

T = TypeVar('T')


class Look(NamedTuple):
    """The orders at one moment.

    Args:
        rate: Orders per second that were sent.
        seconds: Since the first of them; 0 while there is none.
        kafka_to_ros: Moved by that half of the bridge; None while it has not told.
        lost: Never arrived; while orders move, those that later ones have overtaken.
        deleted: Of those, what the broker had deleted before it was read.
        rates: Orders that came back, in each second.
        final: Whether nothing will change any more.
    """

    phase: str
    rate: float
    seconds: float
    produced: int
    kafka_to_ros: int | None
    ros_to_kafka: int | None
    consumed: int
    lost: int
    deleted: int
    duplicated: int
    latency: Latency | None
    rates: Sequence[int]
    final: bool


Show = Callable[[Look], None]


@contextmanager
def view(title: str, *, is_terminal: bool) -> Iterator[Show]:
    """Begin to show; what it yields is called often, with everything as it is then."""
    if is_terminal:
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield _every(
                _REFRESH_S,
                lambda look: page(title, look),
                lambda drawn: live.update(drawn, refresh=True),
            )
    else:
        say(title)
        say('latency: fastest / median / 99th percentile / slowest')
        yield _every(_LINE_S, line, say)


def _every(period_s: float, draw: Callable[[Look], T], show: Callable[[T], None]) -> Show:
    """Show what is new, not too often."""
    shown_s, last = -math.inf, None

    def show_sometimes(look: Look) -> None:
        nonlocal shown_s, last
        if time.monotonic() - shown_s > period_s or look.final:
            shown_s = time.monotonic()
            if (drawn := draw(look)) != last:
                last = drawn
                show(drawn)

    return show_sometimes


def say(words: str, *, is_error: bool = False) -> None:
    """Print a line as it is."""
    print(words, file=sys.stderr if is_error else sys.stdout, flush=True)


# The rows


def _counts(look: Look) -> Sequence[tuple[str, str]]:
    return (
        ('produced', _number(look.produced)),
        ('Kafka -> ROS', _number(look.kafka_to_ros)),
        ('ROS -> Kafka', _number(look.ros_to_kafka)),
        ('consumed', _number(look.consumed)),
        ('lost', _lost(look)),
        ('duplicated', _number(look.duplicated)),
    )


def _times(look: Look) -> Iterator[tuple[str, str]]:
    names = ('latency, fastest', 'median', '99th percentile', 'slowest')
    for name, time_s in zip(names, look.latency or (None,) * len(names), strict=True):
        yield name, '-' if time_s is None else f'{1000 * time_s:,.1f} ms'


def _moves(look: Look) -> Sequence[tuple[str, str]]:
    return (
        ('sent a second', f'{look.rate:,.0f}' if look.rate else '-'),
        ('came back', spark(look.rates, _SPARK_WIDTH)),
        ('', look.phase),
    )


def _number(value: int | None) -> str:
    return '-' if value is None else f'{value:,}'


def _lost(look: Look) -> str:
    return f'{look.lost:,} ({100 * look.lost / max(look.produced, 1):.2f} %)'


# All of it


def page(title: str, look: Look) -> Group:
    """Make all that a terminal shows."""
    table = Table()
    table.add_column()
    table.add_column(_WHO, justify='right', min_width=_SPARK_WIDTH)
    for rows in (_counts, _times, _moves):
        for row in rows(look):
            table.add_row(*row)
        table.add_section()
    return Group(title, table, *(() if look.final else (_HINT,)))


def line(look: Look) -> str:
    """One line, for where there is no terminal."""
    if not look.seconds:
        return f'{_WHO}: {look.phase}'
    counts = ', '.join(f'{name} {text}' for name, text in _counts(look))
    sent = f'{look.seconds:.0f} s, {look.rate:,.0f} sent a second'
    told = f'{_WHO}: {look.phase}, {sent}, {counts}'
    if look.latency is None:
        return told
    return f'{told}, latency {" / ".join(f"{1000 * time_s:.1f}" for time_s in look.latency)} ms'


def summary(look: Look) -> str:
    """Sum up in the columns of the paper's tables and text."""
    moved = (
        f'bridge: Producer {_number(look.produced)}, '
        f'Kafka-ROS {_number(look.kafka_to_ros)}, ROS-Kafka {_number(look.ros_to_kafka)}, '
        f'Consumer {_number(look.consumed)}, lost {_lost(look)}'
    )
    if look.latency is None:
        return moved
    fastest, slowest = look.latency.fastest, look.latency.slowest
    return f'{moved}, fastest {fastest:.6f} s, slowest {slowest:.6f} s'


def spark(values: Sequence[float], width: int) -> str:
    """Draw values as bars between 0 and the highest of them, at most `width` of them.

    More values than that are drawn as the means of neighbours.
    """
    if not values:
        return ''
    count = min(width, len(values))
    edges = [len(values) * number // count for number in range(count + 1)]
    means = [fmean(values[start:end]) for start, end in pairwise(edges)]
    highest = max(means) or 1
    return ''.join(_BARS[round(mean / highest * (len(_BARS) - 1))] for mean in means)
