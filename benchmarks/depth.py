"""How good `ros2-kafka-bridge depth` is: traffic whose truth is known.

    python -m benchmarks.depth --recordings 20

Of each kind of traffic, recordings are made with a seed. From each one the depth for a loss of
one in a million is chosen; then it is compared with the depth that is really needed. That one is
known by formula for M/M/1, else by simulation of 600 million messages: its results stand in
`KINDS`, and `--simulate 600000000` finds them again, in hours.
"""

import argparse
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from benchmarks.machine import machine
from ros2_kafka_bridge.depth import choose, predict, replay

LOSS: Final = 1e-6
MESSAGES: Final = 100_000
CHUNK: Final = 10_000_000
RECORDINGS: Final = 20
# Truth found by simulation is itself off by this much; an interval must only come that close.
_TOLERANCE: Final = 0.25

Times = npt.NDArray[np.int64]
Make = Callable[[np.random.Generator, int], tuple[Times, Times]]
"""Random numbers, messages -> arrivals and service times, in nanoseconds."""


class Traffic(NamedTuple):
    """A kind of traffic.

    Args:
        needed: The depth for `LOSS`.
    """

    words: str
    make: Make
    needed: int


class Score(NamedTuple):
    """What came of the recordings of one kind.

    Args:
        estimated: Estimated depth / needed depth, median.
        recommended: The same of the recommended depth; None where mostly none was named.
        enough: Share of recordings whose recommended depth is enough, of those that name one.
        named: Share of recordings from which a depth is recommended.
        covered: Share whose interval at the needed depth holds the wanted loss, give or take
            `_TOLERANCE`.
    """

    needed: int
    estimated: float
    recommended: float | None
    enough: float
    named: float
    covered: float


# Traffic: a message each millisecond, in the mean, unless its name says otherwise


def _random(load: float, *, constant: bool = False) -> Make:
    def make(random: np.random.Generator, count: int) -> tuple[Times, Times]:
        arrivals = random.exponential(1e6, count).cumsum()
        services = np.full(count, load * 1e6)
        return _whole(arrivals, services if constant else random.exponential(services))

    return make


def _bursts(load: float, mean: int) -> Make:
    def make(random: np.random.Generator, count: int) -> tuple[Times, Times]:
        sizes = random.geometric(1 / mean, 2 * count // mean + 50)
        begins = random.exponential(mean * 1e6, len(sizes)).cumsum()
        return _whole(np.repeat(begins, sizes)[:count], np.full(count, load * 1e6))

    return make


def _on_off(rate: float, service_ns: float) -> Make:
    """On for 50 ms and off for 150 ms, in the mean."""

    def make(random: np.random.Generator, count: int) -> tuple[Times, Times]:
        periods = int(1.5 * count / (0.05 * rate)) + 200
        on_s, off_s = random.exponential(0.05, periods), random.exponential(0.15, periods)
        begins_s = (on_s + off_s).cumsum() - on_s
        numbers = np.floor(on_s * rate).astype(int) + 1
        place = np.arange(numbers.sum()) - np.repeat(numbers.cumsum() - numbers, numbers)
        arrivals_s = np.repeat(begins_s, numbers) + place / rate
        return _whole(1e9 * arrivals_s[:count], np.full(count, service_ns))

    return make


def _many_on_off(random: np.random.Generator, count: int) -> tuple[Times, Times]:
    make = _on_off(200.0, 0.0)
    sources = [make(random, count // 20 + 2000)[0] for _ in range(20)]
    until = min(source[-1] for source in sources)
    arrivals = np.sort(np.concatenate(sources))
    arrivals = arrivals[arrivals <= until][:count]
    return _whole(arrivals, np.full(len(arrivals), 0.7e6))


def _stalls(random: np.random.Generator, count: int) -> tuple[Times, Times]:
    arrivals = random.normal(6.25e6, 1e6, count).clip(1e5).cumsum()
    stalls = (random.random(count) < 0.002) * random.exponential(120e6, count)
    return _whole(arrivals, random.gamma(4, 0.5e6, count) + stalls)


def _pareto(random: np.random.Generator, count: int) -> tuple[Times, Times]:
    arrivals = random.exponential(1e6, count).cumsum()
    return _whole(arrivals, (random.pareto(2.5, count) + 1) * 0.3e6)


def _whole(arrivals: npt.ArrayLike, services: npt.ArrayLike) -> tuple[Times, Times]:
    return np.asarray(arrivals).astype(np.int64), np.asarray(services).astype(np.int64)


def _of_formula(load: float) -> int:
    """The depth for `LOSS` of M/M/1/K, where K counts the one in service, too."""
    depth = 1
    while (1 - load) * load ** (depth + 1) / (1 - load ** (depth + 2)) > LOSS:
        depth += 1
    return depth


KINDS: Final[Mapping[str, Traffic]] = MappingProxyType(
    {
        'mm1-50': Traffic('random, 50 % busy (M/M/1)', _random(0.5), _of_formula(0.5)),
        'mm1-80': Traffic('random, 80 % busy (M/M/1)', _random(0.8), _of_formula(0.8)),
        'mm1-90': Traffic('random, 90 % busy (M/M/1)', _random(0.9), _of_formula(0.9)),
        'md1-80': Traffic(
            'random, constant service, 80 % busy (M/D/1)', _random(0.8, constant=True), 27
        ),
        'bursts': Traffic('bursts of 10 in the mean, 50 % busy', _bursts(0.5, 10), 240),
        'on-off': Traffic('on and off, 50 % busy', _on_off(2000.0, 1e6), 982),
        'many-on-off': Traffic('20 sources on and off, 70 % busy', _many_on_off, 187),
        'stalls': Traffic('even, with stalls of 120 ms in the mean', _stalls, 208),
        'pareto': Traffic('service times with a Pareto tail (2.5)', _pareto, 684),
    }
)


# Scores


def score(traffic: Traffic, recordings: int, messages: int) -> Score:
    """Compare what is chosen from recordings with what is needed."""
    needed = traffic.needed
    estimated, recommended, covered = [], [], []
    for number in range(recordings):
        arrivals, services = traffic.make(np.random.default_rng(5000 + number), messages)
        choice = choose(arrivals, services, LOSS)
        estimated.append((choice.estimated or np.inf) / needed)
        recommended.append((choice.recommended or np.inf) / needed)
        (there,) = predict(arrivals, services, [needed])
        near = LOSS * (1 - _TOLERANCE), LOSS * (1 + _TOLERANCE)
        covered.append(there.low <= near[1] and there.high >= near[0])
    middle = statistics.median(recommended)
    named = [ratio for ratio in recommended if np.isfinite(ratio)]
    return Score(
        needed,
        statistics.median(estimated),
        middle if np.isfinite(middle) else None,
        statistics.mean(ratio >= 1 for ratio in named) if named else 1.0,
        len(named) / recordings,
        statistics.mean(covered),
    )


def simulated_depth(traffic: Traffic, messages: int) -> int:
    """Find the smallest depth whose replayed loss is at most `LOSS`, by halving."""

    def loss(depth: int) -> float:
        lost = 0
        for seed in range(max(1, messages // CHUNK)):
            made = traffic.make(np.random.default_rng(seed), min(messages, CHUNK))
            lost += replay(*made, depth).lost
        return lost / messages

    low, high = 0, 1
    while loss(high) > LOSS:
        low, high = high, 4 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if loss(middle) > LOSS else (low, middle)
    return high


# The command line


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.depth', description='How good the chosen depth is.'
    )
    parser.add_argument('--recordings', type=int, default=RECORDINGS, help='default: %(default)s')
    parser.add_argument('--messages', type=int, default=MESSAGES, help='default: %(default)s')
    parser.add_argument(
        '--simulate', type=int, metavar='MESSAGES', help='find the depths needed, and nothing else'
    )
    parser.add_argument('--kinds', default=','.join(KINDS), help='default: %(default)s')
    options = parser.parse_args(arguments)
    if options.simulate:
        for name in options.kinds.split(','):
            print(name, simulated_depth(KINDS[name], options.simulate))
        return 0
    table = Table(title=f'{options.recordings} recordings of {options.messages:,} messages')
    heads = (
        'needed', 'estimated / needed', 'recommended / needed', 'named', 'enough', 'covered'
    )  # fmt: skip
    table.add_column('traffic')
    for head in heads:
        table.add_column(head, justify='right')
    for name in options.kinds.split(','):
        traffic = KINDS[name]
        found = score(traffic, options.recordings, options.messages)
        recommended = 'none' if found.recommended is None else f'{found.recommended:.1f}'
        table.add_row(
            traffic.words, str(found.needed), f'{found.estimated:.2f}', recommended,
            f'{found.named:.0%}', f'{found.enough:.0%}', f'{found.covered:.0%}',
        )  # fmt: skip
        print(traffic.words, found, file=sys.stderr)
    Console().print(table, machine())
    return 0


if __name__ == '__main__':
    sys.exit(main())
