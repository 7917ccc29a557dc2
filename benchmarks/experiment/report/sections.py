"""The page, in the order in which a reader wants it."""

from collections.abc import Mapping, Sequence

from benchmarks.experiment.report.blocks import (
    Block,
    Code,
    Figure,
    Figures,
    Page,
    Paragraph,
    Plot,
    Points,
    Section,
)
from benchmarks.experiment.report.found import Found
from benchmarks.experiment.report.goals import (
    at_paper_loads,
    goals,
    headline,
    missing,
    p99_ratio,
    problems,
    totals,
    worst,
)
from benchmarks.experiment.report.numbers import (
    NONE,
    between,
    count,
    digits,
    duration,
    percent,
)
from benchmarks.experiment.report.paper import TABLES
from benchmarks.experiment.report.tables import (
    contestants_table,
    costs,
    differences,
    goals_table,
    latencies,
    losses,
    lost_share,
    machine_words,
    matrix,
    p99,
    paper_latency,
    paper_memory,
    paper_table,
    points,
    predicted_table,
    recordings,
    start_ups,
    within,
)
from benchmarks.experiment.results import Prediction


def make_page(found: Found, plots: Mapping[str, Plot]) -> Page:
    """Put it together."""
    setting = found.experiment.setting
    return Page(
        'Kafka to ROS and back: the experiment repeated',
        f'{machine_words(setting)} · {duration(setting.seconds)} a cell · {setting.started}',
        [
            _result(found),
            _paper(found),
            _beyond(found),
            Section('plots', 'Plots', _drawn(plots, 'loss', 'latency', 'memory', 'throughput')),
            _depth(found, plots),
            _how(found),
        ],
    )


def _drawn(plots: Mapping[str, Plot], *names: str) -> Sequence[Block]:
    drawn = [plots[name] for name in names if name in plots]
    return drawn or [Paragraph('Not measured.')]


def _result(found: Found) -> Section:
    blocks: list[Block] = [
        Paragraph(headline(found)),
        _figures(found),
        goals_table(goals(found)),
    ]
    number = len(problems(found))
    if number:
        cells = 'a problem' if number == 1 else f'{number} problems'
        blocks.append(Paragraph(f'The measuring itself had {cells}, listed at the end.'))
    return Section('result', 'Result', blocks)


def _figures(found: Found) -> Figures:
    """What to remember: the paper's worst cell, and ours in all of them."""
    most = worst(found.of('paper'))
    ours = found.of('bridge')
    lost = totals(ours).lost
    at_paper = at_paper_loads(found, 'bridge')
    medians = [one.latency.median for one in at_paper if one.latency]
    ratios = [ratio for one in at_paper if (ratio := p99_ratio(found, one)) is not None]
    return Figures(
        [
            Figure(
                percent(most.counts.loss) if most else NONE,
                "lost by the paper's bridge in its worst cell",
                'bad' if most and most.counts.lost else '',
            ),
            Figure(
                count(lost) if ours else NONE,
                'orders lost by ours, in all cells',
                'bad' if lost else 'good',
            ),
            Figure(
                f'{digits(max(medians))} ms' if medians else NONE,
                "our largest median at the paper's loads",
            ),
            Figure(
                f'{max(ratios):.2f} \N{MULTIPLICATION SIGN}' if ratios else NONE,
                "our 99th percentile against bare loops, at most, at the paper's loads",
            ),
        ]
    )


def _paper(found: Found) -> Section:
    setting = found.experiment.setting
    return Section(
        'paper',
        "The paper's tables",
        [
            Paragraph(
                'Each row is a load of the paper. Beside what the paper published stand its '
                'bridge and ours, measured here. Counts differ with the length of a cell (the '
                f'paper: 10 minutes; here: {duration(setting.seconds)}): compare the share '
                f'that was lost. {NONE} is what the paper did not run. Ours has no depth: its '
                'figures are the same in each table.'
            ),
            *(paper_table(found, number) for number in TABLES),
            paper_latency(found),
            paper_memory(found),
        ],
    )


def _beyond(found: Found) -> Section:
    return Section(
        'beyond',
        'Beyond the paper',
        [
            Paragraph('All loads and all contestants. First at a glance, then every number.'),
            matrix(found, 'loss-matrix', 'Share of the orders that was lost', lost_share),
            matrix(
                found,
                'p99-matrix',
                '99th percentile of latency, in milliseconds',
                p99,
                'Of the orders that came: what is lost has no latency.',
            ),
            losses(found),
            latencies(found),
            start_ups(found),
            costs(found),
        ],
    )


# Choosing the depth


def _depth(found: Found, plots: Mapping[str, Plot]) -> Section:
    predictions = found.experiment.predictions
    blocks: list[Block] = [Paragraph(how_good(predictions))]
    if predictions:
        blocks += [predicted_table(predictions), *_drawn(plots, 'predicted')]
    if found.of('recording'):
        blocks.append(recordings(found))
    return Section('depth', 'Choosing the depth', blocks)


def how_good(predictions: Sequence[Prediction]) -> str:
    """Sum up how near the predictions came."""
    if not predictions:
        return 'No loss was predicted.'
    held = sum(map(within, predictions))
    far = max(predictions, key=lambda one: abs(one.loss - one.measured))
    return (
        '`ros2-kafka-bridge depth` predicts the loss of a depth from a recording of the load by a '
        'reader that loses nothing; it knows nothing of the cell that it predicts. '
        f'{held} of {len(predictions)} intervals of 95 % hold the loss that was measured. The '
        f'largest error is {points(far)} percentage points ({far.load.words}, depth '
        f'{count(far.depth)}: predicted {percent(far.loss)}, measured {percent(far.measured)}).'
    ).replace('`', '')


# How it was done


def _how(found: Found) -> Section:
    setting = found.experiment.setting
    orders = [one.counts.producer for one in found.experiment.results]
    versions = [f'{name} {version}' for name, version in setting.versions.items()]
    sizes = f'{between(orders, lambda n: count(int(n)))} orders each' if orders else 'none'
    blocks: list[Block] = [
        Paragraph('The command that repeats it:'),
        Code(setting.command),
        Points(
            [
                f'Machine: {machine_words(setting)}.',
                f'Versions: {", ".join(versions) or "unknown"}.',
                (
                    f'Started {setting.started}; seed {setting.seed}; orders are sent for '
                    f'{duration(setting.seconds)} a cell, at most; {len(orders)} cells; {sizes}.'
                ),
            ]
        ),
        contestants_table(found),
        differences(found),
        Paragraph('What the measurement cannot tell:'),
        Points(
            [
                (
                    'Producer, broker, both bridges and consumer share one machine and its cores. '
                    "Under the highest loads they compete; the broker's share of the CPU time is "
                    'given for that.'
                ),
                (
                    'Each cell was measured once. How much it would differ in another run is not '
                    'known from this page alone.'
                ),
                (
                    f"A cell lasts {duration(setting.seconds)}, the paper's 10 minutes: what is "
                    'rare is seen less often. Under high loads the number of orders is limited, '
                    'and the cell is shorter still.'
                ),
                ('Latency is that of the orders that came. Who loses the late ones looks faster.'),
                (
                    'The paper names neither its language nor its clients. Its nodes here are '
                    'Algorithms 1 and 2 in Python, with the clients that ours uses.'
                ),
            ]
        ),
    ]
    if gaps := missing(found):
        blocks += [Paragraph('Not measured:'), Points(gaps)]
    blocks.append(Paragraph('Problems that the cells report:'))
    blocks.append(Points(problems(found) or ['none']))
    return Section('how', 'How it was done', blocks)
