"""The tables of numbers: each field as a reader wants it, in Markdown; what is wrong in bold."""

from collections.abc import Callable, Collection, Mapping
from statistics import median
from typing import Final

import pandas as pd

from benchmarks.experiment.report.contestants import title
from benchmarks.experiment.report.measured import OURS, Measured
from benchmarks.experiment.report.numbers import NONE, count, digits, even, percent, tenths
from benchmarks.experiment.report.paper import TABLES, published
from benchmarks.experiment.results import Prediction

Form = Callable[[float], str]
Fields = Mapping[tuple[str, str], tuple[str, Form]]
"""Group and title of each column: where its values are, and how they are written."""

_ABSENT: Final = 'not measured'
_NOTHING_CAME: Final = '**nothing came**'


def tables(measured: Measured) -> Mapping[str, pd.DataFrame]:
    """Make them all, by the names by which the page calls them."""
    return {
        **{
            f'table-{number}': _beside(measured, [depth], _PLACES, _PLACES).droplevel('Depth')
            for number, depth in TABLES.items()
        },
        'paper-latency': _beside(measured, TABLES.values(), _EXTREMES, _USUAL, _BARE),
        'paper-memory': _beside(measured, TABLES.values(), _MEMORY, _MEMORY),
        'loss-matrix': _matrix(measured, 'lost_share', _loss),
        'p99-matrix': _matrix(measured, 'latency_p99_ms', even),
        'losses': _long(measured, _LOST),
        'latencies': _long(measured, _LATENCY),
        'start-ups': _start_ups(measured),
        'costs': _long(measured, _COST),
        'predictions': _predictions(measured),
        'recordings': _shown(measured.of('recording').droplevel('Contestant'), _RECORDED),
    }


# How a field is written


def _wrong_in_bold(form: Form) -> Form:
    return lambda value: f'**{form(value)}**' if value else form(value)


_loss: Final = _wrong_in_bold(percent)
_wrong: Final = _wrong_in_bold(count)


def _ratio(ratio: float) -> str:
    return f'{ratio:.2f}' if ratio < 10 else digits(ratio)


_PLACES: Final[Fields] = {
    ('', 'Producer'): ('producer_orders', count),
    ('', 'Kafka-ROS'): ('kafka_ros_orders', count),
    ('', 'ROS-Kafka'): ('ros_kafka_orders', count),
    ('', 'Consumer'): ('consumer_orders', count),
    ('', 'Lost'): ('lost_share', _loss),
}
_EXTREMES: Final[Fields] = {
    ('', name): (f'latency_{name}_ms', even) for name in ('fastest', 'slowest')
}
_USUAL: Final[Fields] = {
    ('', 'first'): ('latency_first_ms', even),
    ('', 'fastest'): ('latency_fastest_ms', even),
    ('', 'median'): ('latency_median_ms', even),
    ('', '99th'): ('latency_p99_ms', even),
    ('', 'slowest'): ('latency_slowest_ms', even),
}
_BARE: Final[Fields] = {
    ('', 'median'): ('latency_median_ms', even),
    ('', '99th'): ('latency_p99_ms', even),
    ('', 'ours / bare, 99th'): ('ratio_of_ours', '{:.2f}'.format),
}
_MEMORY: Final[Fields] = {
    ('', 'Kafka-ROS before'): ('kafka_ros_before_mib', tenths),
    ('', 'Kafka-ROS peak'): ('kafka_ros_peak_mib', tenths),
    ('', 'ROS-Kafka before'): ('ros_kafka_before_mib', tenths),
    ('', 'ROS-Kafka peak'): ('ros_kafka_peak_mib', tenths),
}
_LOST: Final[Fields] = {
    ('', 'Sent'): ('producer_orders', count),
    ('', 'Came'): ('consumer_orders', count),
    ('Lost', 'in all'): ('lost_orders', _wrong),
    ('Lost', 'share'): ('lost_share', _loss),
    ('Lost where', 'producer → Kafka-ROS'): ('lost_before_ros', _wrong),
    ('Lost where', 'Kafka-ROS → ROS-Kafka'): ('lost_in_ros', _wrong),
    ('Lost where', 'ROS-Kafka → consumer'): ('lost_behind_ros', _wrong),
    ('', 'Duplicated'): ('duplicated_orders', _wrong),
    ('', 'Out of order'): ('out_of_order_orders', _wrong),
}
_LATENCY: Final[Fields] = {
    ('Latency, ms', 'first'): ('latency_first_ms', even),
    ('Latency, ms', 'fastest'): ('latency_fastest_ms', even),
    ('Latency, ms', 'median'): ('latency_median_ms', even),
    ('Latency, ms', '95th'): ('latency_p95_ms', even),
    ('Latency, ms', '99th'): ('latency_p99_ms', even),
    ('Latency, ms', '99.9th'): ('latency_p999_ms', even),
    ('Latency, ms', 'slowest'): ('latency_slowest_ms', even),
    ('', '99th / bare'): ('ratio', _ratio),
    ('Median of each hop, ms', 'to ROS'): ('hop_to_ros_median_ms', even),
    ('Median of each hop, ms', 'to Kafka'): ('hop_to_kafka_median_ms', even),
    ('Median of each hop, ms', 'to consumer'): ('hop_to_consumer_median_ms', even),
}
_COST: Final[Fields] = {
    ('Orders/s', 'sent'): ('sent_orders_per_s', even),
    ('Orders/s', 'delivered'): ('delivered_orders_per_s', even),
    ('Kafka-ROS, MiB', 'before'): ('kafka_ros_before_mib', tenths),
    ('Kafka-ROS, MiB', 'peak'): ('kafka_ros_peak_mib', tenths),
    ('ROS-Kafka, MiB', 'before'): ('ros_kafka_before_mib', tenths),
    ('ROS-Kafka, MiB', 'peak'): ('ros_kafka_peak_mib', tenths),
    ('', 'CPU ms/order'): ('cpu_ms_per_order', even),
    ('', "broker's share of CPU"): ('broker_share', lambda share: f'{100 * share:.0f} %'),
}
_RECORDED: Final[Fields] = {
    ('', 'Sent'): ('producer_orders', count),
    ('', 'Came'): ('consumer_orders', count),
    ('', 'Lost'): ('lost_orders', _wrong),
    ('', 'Delivered/s'): ('delivered_orders_per_s', even),
}


def _shown(cells: pd.DataFrame, fields: Fields, absent: str = _ABSENT) -> pd.DataFrame:
    """Write cells; the first field of those that are not there says why."""
    shown = pd.DataFrame(
        {
            heading: cells[column].map(form, na_action='ignore').astype(object)
            for heading, (column, form) in fields.items()
        },
        index=cells.index,
    )
    is_absent = cells.isna().all(axis='columns')
    why = is_absent.map({True: absent, False: _NOTHING_CAME})
    first = next(iter(fields))
    shown[first] = shown[first].fillna(why)
    if not any(group for group, _ in fields):
        shown.columns = pd.Index([name for _, name in fields])
    return shown.fillna(NONE)


# The paper's own


def _beside(
    measured: Measured,
    depths: Collection[int],
    of_paper: Fields,
    here: Fields,
    of_bare: Fields | None = None,
) -> pd.DataFrame:
    """What the paper published beside what was measured here, by its loads and these depths."""
    rows = pd.MultiIndex.from_product([measured.of_paper, depths], names=['Load', 'Depth'])
    paper, ours, bare = (
        measured.cells.reindex(
            [(load, run) for (load, _), run in zip(rows, runs, strict=True)]
        ).set_axis(rows)
        for runs in (
            [title('paper', depth) for _, depth in rows],
            [OURS] * len(rows),
            [title('bare', None)] * len(rows),
        )
    )
    groups = {
        'Paper, published': _shown(published().reindex(rows), of_paper, NONE),
        "Paper's bridge, here": _shown(paper, here),
        'Ours, here': _shown(ours, here),
    }
    if of_bare:
        groups['Bare loops'] = _shown(bare.assign(ratio_of_ours=ours['ratio']), of_bare)
    return pd.concat(groups, axis='columns')


# All loads and contestants


def _matrix(measured: Measured, column: str, form: Form) -> pd.DataFrame:
    """A row for each contestant, a column for each load."""
    fields = measured.cells[column].map(form, na_action='ignore').astype(object)
    grid = fields.fillna(_NOTHING_CAME).unstack('Load')  # noqa: PD010 (there is nothing to sum up)
    shown = grid.reindex(index=measured.runs, columns=measured.loads).fillna(_ABSENT)
    return shown.rename_axis(index='Contestant', columns=None)


def _long(measured: Measured, fields: Fields) -> pd.DataFrame:
    """Every cell."""
    names = ['Load', 'Contestant']
    rows = pd.MultiIndex.from_product([measured.loads, measured.runs], names=names)
    return _shown(measured.cells.reindex(rows), fields)


def _start_ups(measured: Measured) -> pd.DataFrame:
    """How long each contestant takes to start."""
    starts = {
        title(one.contestant, one.depth): (median(one.seconds), max(one.seconds))
        for one in measured.experiment.starts
    }
    columns = ['median', 'longest']
    seconds = pd.DataFrame.from_dict(starts, orient='index', columns=columns, dtype=float)
    rows = pd.Index(measured.runs, name='Contestant')
    return _shown(seconds.reindex(rows), {('', name): (name, even) for name in columns})


# Choosing the depth


def _predictions(measured: Measured) -> pd.DataFrame:
    """Predicted and measured loss."""
    rows = [
        {
            'Load': one.load.words,
            'Depth': count(one.depth),
            'Predicted': percent(one.loss),
            '95 % interval': f'{percent(one.low)} to {percent(one.high)}',
            'Measured': percent(one.measured),
            'Error, points': points(one),
            'Interval': 'holds it' if within(one) else '**misses it**',
            'Backlog': 'seen' if one.seen else 'estimated',
        }
        for one in measured.experiment.predictions
    ]
    return pd.DataFrame(rows).set_index('Load') if rows else pd.DataFrame()


def within(one: Prediction) -> bool:
    """Whether the interval holds what was measured.

    Where nothing was lost, that says only that the loss is below three messages (rule of three).
    """
    is_nothing = one.measured == 0 and one.low * one.messages <= 3
    return is_nothing or one.low <= one.measured <= one.high


def points(one: Prediction) -> str:
    """The error in percentage points, with its sign."""
    error = 100 * (one.loss - one.measured)
    if abs(error) < 0.001:
        return '0'
    return f'+{even(error)}' if error > 0 else even(error)
