"""The goals, whether they were met, and the result in one paragraph."""

from collections.abc import Callable, Sequence
from typing import Final, Literal, NamedTuple

from benchmarks.experiment.report.found import Found, where
from benchmarks.experiment.report.numbers import between, count, digits, named, percent
from benchmarks.experiment.report.paper import PUBLISHED
from benchmarks.experiment.results import Latency, Load, Result

MEDIAN_MS: Final = 2.5
P99_RATIO: Final = 1.2
_ENOUGH: Final = 1000  # orders, below which the 99th percentile rests on a handful

Verdict = Literal['PASS', 'FAIL', 'NOT MEASURED']


class Goal(NamedTuple):
    """One that was set beforehand.

    Args:
        why: The numbers that decide; of a goal that is not met, the cells that fail.
    """

    words: str
    verdict: Verdict
    why: str


class _Look(NamedTuple):
    """At one cell: what it says, and whether it fails; neither where it was not measured."""

    words: str
    verdict: Verdict


def goals(found: Found) -> Sequence[Goal]:
    """Judge them all."""
    return [
        _goal('No order is lost', _counted(found, 'lost', lambda r: r.counts.lost)),
        _goal(
            'No order is duplicated',
            _counted(found, 'repeated', lambda r: r.counts.duplicated),
        ),
        _goal(
            'No order is out of order',
            _counted(found, 'out of order', lambda r: r.counts.out_of_order),
        ),
        _goal(
            f"Median latency at the paper's loads is at most {digits(MEDIAN_MS)} ms",
            [_median(found, load) for load in found.of_paper],
        ),
        _goal(
            f"99th percentile at the paper's loads is at most {digits(P99_RATIO)} times that of "
            'bare loops',
            [_against_bare(found, load) for load in found.of_paper],
        ),
    ]


def _goal(words: str, looks: Sequence[_Look]) -> Goal:
    """Judge by the cells: one that fails decides; all must be there to pass."""
    for verdict in ('FAIL', 'NOT MEASURED', 'PASS'):
        decisive = [look.words for look in looks if look.verdict == verdict]
        if decisive:
            return Goal(words, verdict, '; '.join(decisive))
    return Goal(words, 'NOT MEASURED', 'no cell')


def _counted(found: Found, what: str, wrong: Callable[[Result], int]) -> Sequence[_Look]:
    """Look at every cell of ours, for a count that must be 0."""
    loads = {load.name: load for load in (*found.of_paper, *found.loads)}
    measured = [(load, found.one('bridge', load.name)) for load in loads.values()]
    looks = [_count_look(load, result, what, wrong) for load, result in measured]
    if all(look.verdict == 'PASS' for look in looks):
        orders = sum(result.counts.producer for _, result in measured if result)
        return [_Look(f'0 of {count(orders)} orders in {_cells(len(looks))}', 'PASS')]
    return looks


def _count_look(
    load: Load, result: Result | None, what: str, wrong: Callable[[Result], int]
) -> _Look:
    if result is None or not result.counts.producer:
        return _Look(f'{load.words}: not measured', 'NOT MEASURED')
    number = wrong(result)
    sent = count(result.counts.producer)
    return _Look(f'{load.words}: {count(number)} of {sent} {what}', 'FAIL' if number else 'PASS')


def _median(found: Found, load: Load) -> _Look:
    result = found.one('bridge', load.name)
    if result is None:
        return _Look(f'{load.words}: not measured', 'NOT MEASURED')
    if result.latency is None:
        return _Look(f'{load.words}: nothing came', 'FAIL')
    median = result.latency.median
    bare = latency_of(found.one('bare', load.name))
    beside = f' (bare loops: {digits(bare.median, 4)} ms)' if bare else ''
    return _Look(
        f'{load.words}: {digits(median, 4)} ms{beside}', 'PASS' if median <= MEDIAN_MS else 'FAIL'
    )


def _against_bare(found: Found, load: Load) -> _Look:
    result = found.one('bridge', load.name)
    if result is not None and result.latency is None:
        return _Look(f'{load.words}: nothing came', 'FAIL')
    ratio = p99_ratio(found, result)
    bare = latency_of(found.one('bare', load.name))
    if result is None or ratio is None or bare is None or result.latency is None:
        who = 'ours' if result is None else 'bare loops'
        return _Look(f'{load.words}: {who} not measured', 'NOT MEASURED')
    words = f'{digits(result.latency.p99)} ms against {digits(bare.p99)} ms'
    if result.counts.consumer < _ENOUGH:
        words += f'; of only {count(result.counts.consumer)} orders'
    return _Look(
        f'{load.words}: {digits(ratio, 4)} ({words})', 'PASS' if ratio <= P99_RATIO else 'FAIL'
    )


def p99_ratio(found: Found, result: Result | None) -> float | None:
    """Divide a cell's 99th percentile by that of bare loops; None where one is not measured."""
    if result is None or result.latency is None:
        return None
    bare = latency_of(found.one('bare', result.cell.load.name))
    return result.latency.p99 / bare.p99 if bare and bare.p99 else None


def latency_of(result: Result | None) -> Latency | None:
    """Its latency, where there is one."""
    return result.latency if result else None


def worst(results: Sequence[Result]) -> Result | None:
    """Find the cell that lost the largest share."""
    return max(results, key=lambda result: result.counts.loss, default=None)


# The result in one paragraph


def headline(found: Found) -> str:
    """Say what came out, with the numbers measured."""
    return ' '.join((_of_paper(found), _of_ours(found), _of_latency(found)))


def _of_paper(found: Found) -> str:
    results = found.of('paper')
    most = worst(results)
    if most is None:
        return "The paper's bridge was not measured."
    said = [f"The paper's bridge lost nothing in {_cells(len(results))}."]
    if most.counts.lost:
        said = [
            (
                f"At worst, the paper's bridge lost {percent(most.counts.loss)} of all orders: "
                f'{count(most.counts.lost)} of {count(most.counts.producer)} ({where(most)}).'
            )
        ]
    names = {load.name for load in found.of_paper}
    at_its_loads = worst([one for one in results if one.cell.load.name in names])
    if at_its_loads and at_its_loads.counts.lost:
        said.append(
            f"At the paper's own loads it lost at most {percent(at_its_loads.counts.loss)} here "
            f'({where(at_its_loads)});'
        )
    elif at_its_loads:
        said.append("At the paper's own loads it lost nothing here;")
    if at_its_loads:
        one = max(PUBLISHED, key=lambda one: one.loss)
        said.append(
            f'the paper published up to {percent(one.loss)} ({one.load} orders/s, depth '
            f'{one.depth}).'
        )
    return ' '.join(said)


def _of_ours(found: Found) -> str:
    results = found.of('bridge')
    if not results:
        return 'Ours was not measured.'
    orders, lost, duplicated, out_of_order = totals(results)
    return (
        f'Ours lost {count(lost)}, duplicated {count(duplicated)} and delivered '
        f'{count(out_of_order)} out of order, of {count(orders)} orders in {_cells(len(results))}.'
    )


class Totals(NamedTuple):
    """Over several cells."""

    orders: int
    lost: int
    duplicated: int
    out_of_order: int


def totals(results: Sequence[Result]) -> Totals:
    """Add up the counts."""
    counts = [result.counts for result in results]
    return Totals(
        sum(one.producer for one in counts),
        sum(one.lost for one in counts),
        sum(one.duplicated for one in counts),
        sum(one.out_of_order for one in counts),
    )


def at_paper_loads(found: Found, name: str) -> Sequence[Result]:
    """Results of a contestant at the paper's loads, where something came."""
    names = {load.name for load in found.of_paper}
    return [one for one in found.of(name) if one.cell.load.name in names and one.latency]


def _of_latency(found: Found) -> str:
    ours = [one.latency for one in at_paper_loads(found, 'bridge') if one.latency]
    if not ours:
        return "Its latency at the paper's loads was not measured."
    said = [
        (
            f"At the paper's loads its median latency is {between(one.median for one in ours)} ms "
            f'and its 99th percentile {between(one.p99 for one in ours)} ms'
        )
    ]
    ratios = [p99_ratio(found, one) for one in at_paper_loads(found, 'bridge')]
    known = [ratio for ratio in ratios if ratio is not None]
    if known:
        said.append(
            f', which is {between(known, lambda ratio: f"{ratio:.2f}")} times that of bare loops '
            'in the same run'
        )
    papers = [one.latency for one in at_paper_loads(found, 'paper') if one.latency]
    if papers:
        said.append(
            f"; the paper's bridge here has a median of {between(one.median for one in papers)} "
            f'ms and a 99th percentile of {between(one.p99 for one in papers)} ms'
        )
    fastest = 1000 * min(one.fastest_s for one in PUBLISHED)
    slowest = 1000 * max(one.slowest_s for one in PUBLISHED)
    said.append(
        f'. The paper published {digits(fastest)} ms for its fastest order and {digits(slowest)} '
        f'ms for its slowest; our slowest at these loads took '
        f'{digits(max(one.slowest for one in ours))} ms.'
    )
    return ''.join(said)


def problems(found: Found) -> Sequence[str]:
    """List what went wrong with the measuring itself, with the cell."""
    return [
        f'{one.cell.key}: {problem}'
        for one in found.experiment.results
        for problem in one.problems
    ]


def missing(found: Found) -> Sequence[str]:
    """List the cells that would be there had none been left out."""
    return [
        f'{run.title}: {named(gaps)}'
        for run in found.runs
        if (gaps := [load.words for load in found.loads if found.at(run, load.name) is None])
    ]


def _cells(number: int) -> str:
    return '1 cell' if number == 1 else f'{number} cells'
