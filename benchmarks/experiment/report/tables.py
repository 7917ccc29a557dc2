"""The tables: the paper's own beside ours, then all that was measured."""

from collections.abc import Callable, Sequence
from statistics import median
from typing import Final, NamedTuple

from benchmarks.experiment.report.blocks import ABSENT, DASH, Column, Table, Text, Tone
from benchmarks.experiment.report.contestants import ORDER, contestant
from benchmarks.experiment.report.found import Found, Run
from benchmarks.experiment.report.goals import Goal, p99_ratio
from benchmarks.experiment.report.numbers import (
    count,
    digits,
    duration,
    even,
    named,
    percent,
    tenths,
)
from benchmarks.experiment.report.paper import (
    MACHINE,
    PLACES,
    SECONDS,
    TABLES,
    Published,
    published,
)
from benchmarks.experiment.results import Hops, Latency, Load, Prediction, Result, Setting, StartUp

_OURS: Final = Run('bridge', None)
_PLACES: Final = ('Producer', 'Kafka-ROS', 'ROS-Kafka', 'Consumer', 'Lost')
_PUBLISHED: Final = 'Paper, published'
_HERE: Final = "Paper's bridge, here"
_OURS_HERE: Final = 'Ours, here'


def goals_table(goals: Sequence[Goal]) -> Table:
    """The goals and whether each was met."""
    tones: dict[str, Tone] = {'PASS': 'good', 'FAIL': 'bad', 'NOT MEASURED': 'absent'}
    rows = [
        (Text(goal.words), Text(goal.verdict, tones[goal.verdict]), Text(goal.why))
        for goal in goals
    ]
    columns = [Column('Goal', is_words=True), Column('Verdict', is_words=True)]
    return Table('goals', 'The goals', [*columns, Column('Measured', is_words=True)], rows)


# The paper's own


def paper_table(found: Found, number: str) -> Table:
    """One of Tables I to III, as the paper has it, with what was measured here."""
    depth = TABLES[number]
    columns = [Column('Load', is_words=True)]
    for group in (_PUBLISHED, _HERE, _OURS_HERE):
        columns += [Column(place, group) for place in _PLACES]
    rows = [
        (
            Text(load.words),
            *_published_places(published(load.name, depth)),
            *_places(found.at(Run('paper', depth), load.name)),
            *_places(found.at(_OURS, load.name)),
        )
        for load in found.of_paper
    ]
    return Table(f'table-{number}', f'TABLE {number}: QoS Profile Depth={depth}', columns, rows)


def _published_places(one: Published | None) -> Sequence[Text]:
    if one is None:
        return [DASH] * len(_PLACES)
    places = (one.producer, one.kafka_ros, one.ros_kafka, one.consumer)
    return [*(Text(count(place)) for place in places), _loss(one.loss)]


def _places(result: Result | None) -> Sequence[Text]:
    if result is None:
        return [ABSENT, *[DASH] * (len(_PLACES) - 1)]
    counts = result.counts
    places = (counts.producer, counts.kafka_ros, counts.ros_kafka, counts.consumer)
    return [*(Text(count(place)) for place in places), _loss(counts.loss)]


def _loss(share: float) -> Text:
    return Text(percent(share), 'bad' if share else 'good')


def paper_latency(found: Found) -> Table:
    """Latencies: those of the prose beside those measured here."""
    names = ('first', 'fastest', 'median', '99th', 'slowest')
    columns = [
        Column('Load', is_words=True), Column('Depth'),
        Column('fastest', _PUBLISHED), Column('slowest', _PUBLISHED),
        *(Column(name, group) for group in (_HERE, _OURS_HERE) for name in names),
        *(Column(name, 'Bare loops') for name in ('median', '99th', 'ours / bare, 99th')),
    ]  # fmt: skip
    rows = [
        (
            *_who(load, depth),
            *_published_latency(published(load.name, depth)),
            *_latencies(found.at(Run('paper', depth), load.name)),
            *_latencies(found.at(_OURS, load.name)),
            *_bare(found, load),
        )
        for load in found.of_paper
        for depth in TABLES.values()
    ]
    return Table(
        'paper-latency',
        'Latency from the producer to the consumer, in milliseconds, of the orders that came',
        columns,
        rows,
        notes=['First: of the first order of a cell, after some seconds without any.'],
        starts=range(0, len(rows), len(TABLES)),
    )


def _who(load: Load, depth: int) -> Sequence[Text]:
    tone: Tone = '' if depth == min(TABLES.values()) else 'again'
    return Text(load.words, tone), Text(str(depth))


def _published_latency(one: Published | None) -> Sequence[Text]:
    if one is None:
        return DASH, DASH
    return Text(even(1000 * one.fastest_s)), Text(even(1000 * one.slowest_s))


def _latencies(result: Result | None) -> Sequence[Text]:
    if result is None or result.latency is None:
        return [_not(result), *[DASH] * 4]
    latency = result.latency
    values = (latency.first, latency.fastest, latency.median, latency.p99, latency.slowest)
    return [Text(even(value)) for value in values]


def _not(result: Result | None) -> Text:
    return ABSENT if result is None else Text('nothing came', 'bad')


def _bare(found: Found, load: Load) -> Sequence[Text]:
    bare = found.one('bare', load.name)
    if bare is None or bare.latency is None:
        return _not(bare), DASH, DASH
    ratio = p99_ratio(found, found.at(_OURS, load.name))
    return (
        Text(even(bare.latency.median)),
        Text(even(bare.latency.p99)),
        DASH if ratio is None else Text(f'{ratio:.2f}'),
    )


def paper_memory(found: Found) -> Table:
    """Memory: that of the prose beside that measured here."""
    titles = ('Kafka-ROS before', 'peak', 'ROS-Kafka before', 'peak')
    groups = (_PUBLISHED, _HERE, _OURS_HERE)
    columns = [Column('Load', is_words=True), Column('Depth')]
    columns += [Column(title, group) for group in groups for title in titles]
    rows = [
        (
            *_who(load, depth),
            *_published_memory(published(load.name, depth)),
            *_memory(found.at(Run('paper', depth), load.name)),
            *_memory(found.at(_OURS, load.name)),
        )
        for load in found.of_paper
        for depth in TABLES.values()
    ]
    return Table(
        'paper-memory',
        'Memory of the two bridges, in MiB',
        columns,
        rows,
        notes=[
            (
                'Published: of a container, by an unnamed language. Here: anonymous memory of a '
                'Python process, with interpreter and ROS 2 libraries. Compare the growth, not '
                'the size.'
            )
        ],
        starts=range(0, len(rows), len(TABLES)),
    )


def _published_memory(one: Published | None) -> Sequence[Text]:
    if one is None:
        return [DASH] * 4
    return [Text(tenths(value)) for value in (*one.kafka_ros_memory, *one.ros_kafka_memory)]


def _memory(result: Result | None) -> Sequence[Text]:
    if result is None:
        return [ABSENT, DASH, DASH, DASH]
    sides = (result.kafka_ros, result.ros_kafka)
    return [Text(tenths(mib)) for side in sides for mib in (side.before_mib, side.peak_mib)]


# All loads and contestants


def matrix(
    found: Found, name: str, caption: str, read: Callable[[Result], Text], *notes: str
) -> Table:
    """A row for each contestant, a column for each load."""
    columns = [Column('', is_words=True), *(Column(load.words) for load in found.loads)]
    rows = [
        (_named(run), *(_field(found.at(run, load.name), read) for load in found.loads))
        for run in found.runs
    ]
    return Table(name, caption, columns, rows, notes)


def _named(run: Run) -> Text:
    return Text(run.title, 'ours' if run == _OURS else '')


def _field(result: Result | None, read: Callable[[Result], Text]) -> Text:
    return ABSENT if result is None else read(result)


def lost_share(result: Result) -> Text:
    """What share was lost."""
    return _loss(result.counts.loss)


def p99(result: Result) -> Text:
    """99th percentile, in milliseconds."""
    return Text(even(result.latency.p99)) if result.latency else _not(result)


class _Field(NamedTuple):
    """A column of the long tables."""

    column: Column
    read: Callable[[Found, Result], Text]


def _zero(number: int) -> Text:
    return Text(count(number), 'bad' if number else '')


def _ms(read: Callable[[Latency], float]) -> Callable[[Found, Result], Text]:
    return lambda _, result: Text(even(read(result.latency))) if result.latency else DASH


def _hop(read: Callable[[Hops], float]) -> Callable[[Found, Result], Text]:
    return lambda _, result: Text(even(read(result.hops))) if result.hops else DASH


def _ratio(found: Found, result: Result) -> Text:
    ratio = p99_ratio(found, result)
    return DASH if ratio is None else Text(f'{ratio:.2f}' if ratio < 10 else digits(ratio))


_LOST: Final = (
    _Field(Column('Sent'), lambda _, r: Text(count(r.counts.producer))),
    _Field(Column('Came'), lambda _, r: Text(count(r.counts.consumer))),
    _Field(Column('in all', 'Lost'), lambda _, r: _zero(r.counts.lost)),
    _Field(Column('share', 'Lost'), lambda _, r: _loss(r.counts.loss)),
    _Field(
        Column('producer → Kafka-ROS', 'Lost where'),
        lambda _, r: _zero(r.counts.producer - r.counts.kafka_ros),
    ),
    _Field(
        Column('Kafka-ROS → ROS-Kafka', 'Lost where'),
        lambda _, r: _zero(r.counts.kafka_ros - r.counts.ros_kafka),
    ),
    _Field(
        Column('ROS-Kafka → consumer', 'Lost where'),
        lambda _, r: _zero(r.counts.ros_kafka - r.counts.consumer),
    ),
    _Field(Column('Duplicated'), lambda _, r: _zero(r.counts.duplicated)),
    _Field(Column('Out of order'), lambda _, r: _zero(r.counts.out_of_order)),
)

_QUANTILES: Final = 'Latency, ms'
_HOPS: Final = 'Median of each hop, ms'
_LATENCY: Final = (
    _Field(Column('first', _QUANTILES), _ms(lambda latency: latency.first)),
    _Field(Column('fastest', _QUANTILES), _ms(lambda latency: latency.fastest)),
    _Field(Column('median', _QUANTILES), _ms(lambda latency: latency.median)),
    _Field(Column('95th', _QUANTILES), _ms(lambda latency: latency.p95)),
    _Field(Column('99th', _QUANTILES), _ms(lambda latency: latency.p99)),
    _Field(Column('99.9th', _QUANTILES), _ms(lambda latency: latency.p999)),
    _Field(Column('slowest', _QUANTILES), _ms(lambda latency: latency.slowest)),
    _Field(Column('99th / bare'), _ratio),
    _Field(Column('to ROS', _HOPS), _hop(lambda hops: hops.to_ros)),
    _Field(Column('to Kafka', _HOPS), _hop(lambda hops: hops.to_kafka)),
    _Field(Column('to consumer', _HOPS), _hop(lambda hops: hops.to_consumer)),
)

_K2R: Final = 'Kafka-ROS, MiB'
_R2K: Final = 'ROS-Kafka, MiB'
_COST: Final = (
    _Field(Column('sent', 'Orders/s'), lambda _, r: Text(even(r.sent_per_s))),
    _Field(Column('delivered', 'Orders/s'), lambda _, r: Text(even(r.delivered_per_s))),
    _Field(Column('before', _K2R), lambda _, r: Text(tenths(r.kafka_ros.before_mib))),
    _Field(Column('peak', _K2R), lambda _, r: Text(tenths(r.kafka_ros.peak_mib))),
    _Field(Column('before', _R2K), lambda _, r: Text(tenths(r.ros_kafka.before_mib))),
    _Field(Column('peak', _R2K), lambda _, r: Text(tenths(r.ros_kafka.peak_mib))),
    _Field(Column('CPU ms/order'), lambda _, r: Text(even(r.cpu_ms_per_order))),
    _Field(Column("broker's share of CPU"), lambda _, r: _broker(r)),
)


def _broker(result: Result) -> Text:
    return Text(f'{100 * result.broker_share:.0f} %') if result.broker.cpu_s else DASH


def losses(found: Found) -> Table:
    """What was lost and where, for every cell."""
    return _long(found, 'losses', 'What was lost, and where', _LOST)


def latencies(found: Found) -> Table:
    """Latency, for every cell."""
    notes = [
        (
            'Of the orders that came: what is lost has no latency, so that losing flatters. '
            'Hops are known where the records tell them.'
        ),
        (
            'Medians of hops do not add up to the median of the whole. The broker stamps whole '
            'milliseconds: the split between the last two hops is off by up to half of one.'
        ),
    ]
    return _long(found, 'latencies', 'How long it took', _LATENCY, notes)


def start_ups(found: Found) -> Table:
    """How long each contestant takes to start."""
    columns = [Column('Contestant', is_words=True), Column('median'), Column('longest')]
    rows = [(_named(run), *_start_up(found.experiment.starts, run)) for run in found.runs]
    return Table(
        'start-ups',
        'Start-up: seconds from the start of both bridges until an order that waited in Kafka has '
        'come through',
        columns,
        rows,
        notes=[
            (
                'No part of any latency: the bridges of a cell stand idle before its first order. '
                'Bare loops join Kafka only when they know their subscriber, the others meanwhile.'
            )
        ],
    )


def _start_up(starts: Sequence[StartUp], run: Run) -> Sequence[Text]:
    found = next((one for one in starts if (one.contestant, one.depth) == run), None)
    if found is None:
        return ABSENT, DASH
    return Text(even(median(found.seconds))), Text(even(max(found.seconds)))


def costs(found: Found) -> Table:
    """Throughput, memory and CPU time, for every cell."""
    notes = [
        (
            "CPU: both bridges, for each order that came. The broker's share: of the CPU time of "
            'broker and bridges.'
        )
    ]
    return _long(found, 'costs', 'How much was carried, and what it cost', _COST, notes)


def _long(
    found: Found, name: str, caption: str, fields: Sequence[_Field], notes: Sequence[str] = ()
) -> Table:
    columns = [Column('Load', is_words=True), Column('Contestant', is_words=True)]
    rows: list[Sequence[Text]] = []
    for load in found.loads:
        for i, run in enumerate(found.runs):
            who = (Text(load.words, 'again' if i else ''), _named(run))
            rows.append((*who, *_row(found, found.at(run, load.name), fields)))
    return Table(
        name,
        caption,
        [*columns, *(field.column for field in fields)],
        rows,
        notes,
        starts=range(0, len(rows), max(1, len(found.runs))),
        is_long=True,
    )


def _row(found: Found, result: Result | None, fields: Sequence[_Field]) -> Sequence[Text]:
    if result is None:
        return [ABSENT, *[DASH] * (len(fields) - 1)]
    return [field.read(found, result) for field in fields]


# Choosing the depth


def within(one: Prediction) -> bool:
    """Whether the interval holds what was measured.

    Where nothing was lost, that says only that the loss is below three messages (rule of three).
    """
    is_nothing = one.measured == 0 and one.low * one.messages <= 3
    return is_nothing or one.low <= one.measured <= one.high


def predicted_table(predictions: Sequence[Prediction]) -> Table:
    """Predicted and measured loss."""
    columns = [
        Column('Load', is_words=True), Column('Depth'), Column('Predicted'),
        Column('95 % interval'), Column('Measured'), Column('Error, points'),
        Column('Interval', is_words=True), Column('Backlog', is_words=True),
    ]  # fmt: skip
    rows = [
        (
            Text(one.load.words),
            Text(count(one.depth)),
            Text(percent(one.loss)),
            Text(f'{percent(one.low)} to {percent(one.high)}'),
            Text(percent(one.measured)),
            Text(points(one)),
            Text('holds it', 'good') if within(one) else Text('misses it', 'bad'),
            Text('seen' if one.seen else 'estimated'),
        )
        for one in predictions
    ]
    return Table(
        'predictions',
        'Share lost between the two bridges: predicted from a recording, and measured',
        columns,
        rows,
        notes=[
            ('Backlog: seen where the loss is that of the replay; else its tail is estimated.')
        ],
    )


def points(one: Prediction) -> str:
    """The error in percentage points, with its sign."""
    error = 100 * (one.loss - one.measured)
    if abs(error) < 0.001:
        return '0'
    return f'+{even(error)}' if error > 0 else even(error)


def recordings(found: Found) -> Table:
    """What the predictions are made from."""
    columns = [
        Column('Load', is_words=True), Column('Sent'), Column('Came'), Column('Lost'),
        Column('Delivered/s'),
    ]  # fmt: skip
    rows = [
        (
            Text(one.cell.load.words),
            Text(count(one.counts.producer)),
            Text(count(one.counts.consumer)),
            _zero(one.counts.lost),
            Text(even(one.delivered_per_s)),
        )
        for one in found.of('recording')
    ]
    notes = [
        (
            'A reader that loses nothing costs processor time, and slows its publisher where they '
            'share a machine. A recording that delivered far fewer orders a second than its load '
            'is no recording of that load: what it predicts is too low.'
        )
    ]
    return Table('recordings', 'The recordings', columns, rows, notes=notes)


# How it was done


def differences(found: Found) -> Table:
    """What differs from the paper."""
    return Table(
        'differences',
        'What differs from the paper',
        [Column('', is_words=True), Column('Paper', is_words=True), Column('Here', is_words=True)],
        [tuple(map(Text, row)) for row in _differing(found)],
    )


def _differing(found: Found) -> Sequence[tuple[str, str, str]]:
    setting = found.experiment.setting
    broker = 'one broker, started for the run' if setting.kafka == 'local' else setting.kafka
    return [
        ('Machine', MACHINE, machine_words(setting)),
        ('Separation', PLACES, 'processes on one machine, no containers'),
        ('Length of a cell', duration(SECONDS), duration(setting.seconds)),
        ('Kafka', 'one partition, one replica', broker + '; one partition, one replica'),
        (
            'Loads',
            'named by their counts alone: 5,787, about 51,000 and about 97,000 orders',
            'the same as rates, and those beyond: '
            + '; '.join(load.words for load in found.loads),
        ),
        ('Depths', named(map(str, TABLES.values())), _depths(found)),
        (
            'Latency',
            'fastest and slowest order',
            'quantiles of all that came, each order stamped by its producer',
        ),
        ('Memory', 'of the containers', 'anonymous memory of the processes'),
    ]


def _depths(found: Found) -> str:
    depths = sorted({run.depth for run in found.runs if run.depth is not None})
    return named(map(count, depths)) if depths else 'none'


def machine_words(setting: Setting) -> str:
    """Describe the machine: what is known by name first, then all else."""
    rest = dict(setting.machine)
    cores, cpu = rest.pop('cores', None), rest.pop('cpu', None)
    memory = rest.pop('memory_gib', None)
    words = [] if cores is None else [f'{cores} cores' if cores != 1 else '1 core']
    words += [] if cpu is None else [f'of {cpu}' if words else str(cpu)]
    said = [' '.join(words)] if words else []
    said += [] if memory is None else [f'{memory} GiB']
    return ', '.join([*said, *(f'{name} {value}' for name, value in rest.items())]) or 'unknown'


def contestants_table(found: Found) -> Table:
    """What each contestant is."""
    names = list(dict.fromkeys(one.cell.contestant for one in found.experiment.results))
    known = [contestant(name) for name in sorted(names, key=_place)]
    return Table(
        'contestants',
        'Contestants',
        [Column('', is_words=True), Column('What it is', is_words=True)],
        [(Text(one.title), Text(one.what or 'not described')) for one in known],
    )


def _place(name: str) -> tuple[int, str]:
    return ORDER.index(name) if name in ORDER else len(ORDER), name
