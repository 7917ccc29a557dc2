"""What a person sees: a table that lives in a terminal, or plain lines."""

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from statistics import fmean
from typing import Final, NamedTuple

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from ros2_kafka_bridge.demo.tally import Latency

_REFRESH_S: Final = 0.25
_LINE_S: Final = 1.0
_SPARK_WIDTH: Final = 24  # two of them, the words and the frame fit into 80 columns
_BARS: Final = '▁▂▃▄▅▆▇█'
_HINT: Final = 'Kafka -> ROS, ROS -> Kafka: as told once a second. Ctrl-C: stop and count.'


class Look(NamedTuple):
    """One contestant at one moment.

    Args:
        rate: Orders per second that were sent.
        seconds: Since the first of them.
        kafka_to_ros: Moved by that half of it; None while it has not told.
        lost: Never arrived; while orders move, those that later ones have overtaken.
        deleted: Of those, what the broker had deleted before it was read.
        rates: Orders that came back, in each second.
        final: Whether nothing will change any more.
    """

    name: str
    title: str
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


Show = Callable[[Sequence[Look]], None]


@contextmanager
def view(title: str, *, is_terminal: bool) -> Iterator[Show]:
    """Begin to show; what it yields is called often, with everything as it is then."""
    if is_terminal:
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield _every(_REFRESH_S, lambda looks: live.update(page(title, looks), refresh=True))
    else:
        say(title)
        say('latency: fastest / median / 99th percentile / slowest')
        yield _every(_LINE_S, _say_news())


def _every(period_s: float, show: Show) -> Show:
    shown_s = -math.inf

    def show_sometimes(looks: Sequence[Look]) -> None:
        nonlocal shown_s
        if time.monotonic() - shown_s > period_s or looks[-1].final:
            shown_s = time.monotonic()
            show(looks)

    return show_sometimes


def _say_news() -> Show:
    last = ''

    def say_news(looks: Sequence[Look]) -> None:
        nonlocal last
        if (now := line(looks[-1])) != last:
            last = now
            say(now)

    return say_news


def say(words: str, *, is_error: bool = False) -> None:
    """Print a line as it is."""
    print(words, file=sys.stderr if is_error else sys.stdout, flush=True)


# The rows, and what each shows of a contestant


def _number(value: int | None) -> str:
    return '-' if value is None else f'{value:,}'


def _time(read: Callable[[Latency], float]) -> Callable[[Look], str]:
    return lambda look: '-' if look.latency is None else f'{read(look.latency) * 1000:,.1f} ms'


def _rate(look: Look) -> str:
    return f'{look.rate:,.0f}' if look.rate else '-'


def _lost(look: Look) -> str:
    return f'{look.lost:,} ({percent_lost(look):.2f} %)'


_Rows = Sequence[tuple[str, Callable[[Look], str]]]

COUNTS: Final[_Rows] = (
    ('produced', lambda look: _number(look.produced)),
    ('Kafka -> ROS', lambda look: _number(look.kafka_to_ros)),
    ('ROS -> Kafka', lambda look: _number(look.ros_to_kafka)),
    ('consumed', lambda look: _number(look.consumed)),
    ('lost', _lost),
    ('duplicated', lambda look: _number(look.duplicated)),
)

TIMES: Final[_Rows] = (
    ('latency, fastest', _time(lambda latency: latency.fastest)),
    ('median', _time(lambda latency: latency.median)),
    ('99th percentile', _time(lambda latency: latency.percentile_99)),
    ('slowest', _time(lambda latency: latency.slowest)),
)


def percent_lost(look: Look) -> float:
    """Of those that were produced."""
    return 100 * look.lost / max(look.produced, 1)


def summary(look: Look) -> str:
    """Sum up in the columns of the paper's tables and text."""
    moved = (
        f'Producer {_number(look.produced)}, Kafka-ROS {_number(look.kafka_to_ros)}, '
        f'ROS-Kafka {_number(look.ros_to_kafka)}, Consumer {_number(look.consumed)}, '
        f'lost {_lost(look)}'
    )
    if look.latency is None:
        return f'{look.name}: {moved}'
    fastest, slowest = look.latency.fastest, look.latency.slowest
    return f'{look.name}: {moved}, fastest {fastest:.6f} s, slowest {slowest:.6f} s'


def page(title: str, looks: Sequence[Look]) -> Group:
    """Make all that is shown."""
    hint = () if looks[-1].final else (_HINT,)
    return Group(title, table(looks), *hint)


def table(looks: Sequence[Look]) -> Table:
    """Make the table, a column for each contestant."""
    made = Table()
    made.add_column()
    for look in looks:
        made.add_column(look.title, justify='right', min_width=_SPARK_WIDTH)
    for words, read in COUNTS:
        made.add_row(words, *map(read, looks))
    made.add_section()
    for words, read in TIMES:
        made.add_row(words, *map(read, looks))
    made.add_section()
    made.add_row('sent a second', *map(_rate, looks))
    made.add_row('came back', *(spark(look.rates, _SPARK_WIDTH) for look in looks))
    made.add_row('', *(look.phase for look in looks))
    return made


def line(look: Look) -> str:
    """One line of a contestant, for where there is no terminal."""
    if not look.seconds:
        return f'{look.title}: {look.phase}'
    counts = ', '.join(f'{name} {read(look)}' for name, read in COUNTS)
    sent = f'{look.seconds:.0f} s, {look.rate:,.0f} sent a second'
    told = f'{look.title}: {look.phase}, {sent}, {counts}'
    if look.latency is None:
        return told
    return f'{told}, latency {" / ".join(f"{1000 * time_s:.1f}" for time_s in look.latency)} ms'


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
