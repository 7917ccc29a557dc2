"""The plots, as SVG that is the same for the same numbers."""

import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import matplotlib.style
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.experiment.report.contestants import contestant
from benchmarks.experiment.report.measured import Measured
from benchmarks.experiment.report.numbers import digits
from benchmarks.experiment.report.paper import RATES, published
from benchmarks.experiment.results import SHARES, Prediction

_STYLE: Final = Path(__file__).with_suffix('.mplstyle')
_WIDTH: Final = 11.0  # inches, of every plot
_FAINT: Final[dict[str, Any]] = {'color': '#8a8a8a', 'linewidth': 1.0, 'linestyle': ':'}
_NO_DATE: Final = {'Date': None, 'Creator': None, 'Format': None, 'Type': None}
# Loads at which a picture says most.
_LATENCY_LOADS: Final = (*RATES, '1000', '5000')
_MEMORY_LOADS: Final = ('160', '5000', '20000', 'max', 'bursts')
_MOST_PANELS: Final = 4


def draw(measured: Measured) -> Mapping[str, str]:
    """Draw all for which there is something to be drawn, by name."""
    cells = measured.cells[measured.cells['contestant'] != 'recording']
    with mpl.style.context(_STYLE):
        drawn = {
            'loss': _loss(cells, measured.depths),
            'latency': _latency(_shallowest(cells)),
            'memory': _memory(_shallowest(cells)),
            'throughput': _throughput(_shallowest(cells)),
            'predicted': _predicted(measured.experiment.predictions),
        }
        return {name: _svg(name, figure) for name, figure in drawn.items() if figure}


def _shallowest(cells: pd.DataFrame) -> pd.DataFrame:
    """Each contestant once, with its smallest depth."""
    depth = cells['depth_messages'].fillna(0)
    return cells[depth == depth.groupby(cells['contestant']).transform('min')]


def _loss(cells: pd.DataFrame, depths: Sequence[int]) -> Figure | None:
    """A panel for each depth; those that have no depth are in all of them."""
    if cells.empty:
        return None
    figure, panels = _panels(1, len(depths) or 1, 4.0, sharey=True)
    cells = cells.assign(place=_load_places(cells))
    for depth, axes in zip(depths or [0], panels, strict=True):
        depth_of = cells['depth_messages']
        for name, ones in _by_contestant(cells[depth_of.isna() | (depth_of == depth)]):
            even = ones[ones['is_even']]
            _line(axes, name, even['place'], 100 * even['lost_share'], f'{name}-{depth}')
            points = _line(
                axes, name, ones['place'], 100 * ones['lost_share'], f'{name}-{depth}-points'
            )
            points.set(
                linestyle='', marker=contestant(name).marker, zorder=7 if name == 'bridge' else 6
            )
        axes.set_title(f'depth {depth}' if depth else 'no depth')
        axes.set_yscale('symlog', linthresh=0.1, linscale=0.5)
        axes.set_ylim(-0.02, 140)
        axes.set_yticks([0, 0.1, 1, 10, 100], ['0 %', '0.1 %', '1 %', '10 %', '100 %'])
        _load_axis(axes, cells)
    panels[0].set_ylabel('orders lost')
    _legend(figure, cells)
    return figure


def _load_places(cells: pd.DataFrame) -> 'pd.Series[float]':
    """Where each load stands: by its rate, those without an even one at the right."""
    last = cells['rate_orders_per_s'][cells['is_even']].max()
    beyond = cells['load'][~cells['is_even']]
    steps = beyond.map({load: place for place, load in enumerate(beyond.unique(), 1)})
    at_right = (1.0 if pd.isna(last) else last) * 10 ** (0.55 * steps)
    return cells['rate_orders_per_s'].where(cells['is_even'], at_right)


def _load_axis(axes: Axes, cells: pd.DataFrame) -> None:
    loads = cells.drop_duplicates('load')
    labels = loads['rate_orders_per_s'].map(lambda rate: digits(rate, 2))
    axes.set_xscale('log')
    axes.set_xticks(
        loads['place'], labels.where(loads['is_even'], loads['load']),
        rotation=50, ha='right', rotation_mode='anchor',
    )  # fmt: skip
    axes.minorticks_off()
    axes.set_xlim(loads['place'].min() / 1.6, loads['place'].max() * 1.6)
    axes.set_xlabel('orders/s')


def _latency(cells: pd.DataFrame) -> Figure | None:
    """A panel for each load: the latency that each share of the orders kept within."""
    curves = cells['result'].map(lambda one: one.latency.curve if one.latency else ())
    cells = cells[cells['load'].isin(_LATENCY_LOADS) & (curves.map(len) == len(SHARES))]
    loads = list(cells['load'].unique())
    if not loads:
        return None
    of_paper = published().groupby('Load').first()
    across = min(3, len(loads))
    figure, panels = _panels(math.ceil(len(loads) / across), across, 3.1, sharey=True)
    for load, axes in zip(loads, panels, strict=False):
        for name, one in _by_contestant(cells[cells['load'] == load]):
            curve = one['result'].iloc[0].latency.curve
            _line(axes, name, _nines(SHARES), curve, f'{name}-{load}')
        title = one.index[0][0]
        for end in ('fastest', 'slowest') if title in of_paper.index else ():
            ms = of_paper.loc[title, f'latency_{end}_ms']
            axes.axhline(ms, **_FAINT, gid=f'published-{end}-{load}')
        axes.set_title(title)
        axes.set_yscale('log')
        axes.yaxis.set_major_formatter('{x:g}')
        shares = (0.5, 0.9, 0.99, 0.999, 0.9999, 1.0)
        axes.set_xticks(_nines(shares), [f'{100 * s:g} %' for s in shares], rotation=35)
        axes.set_xlim(0, _nines([1.0])[0])
    for axes in panels[len(loads) :]:
        axes.remove()
    figure.supxlabel('share of the orders that came', fontsize=9)
    figure.supylabel('latency, ms', fontsize=9)
    _legend(figure, cells, Line2D([], [], **_FAINT, label='published: fastest and slowest order'))
    return figure


def _nines(shares: Iterable[float]) -> Sequence[float]:
    """Where shares stand on an axis that gives each further nine the same room."""
    return [-math.log10(max(1 - share, 10**-4.7)) for share in shares]


def _memory(cells: pd.DataFrame) -> Figure | None:
    """A row for each of the two bridges, a column for each load."""
    has_memory = cells['result'].map(
        lambda one: bool(one.kafka_ros.memory_mib or one.ros_kafka.memory_mib)
    )
    cells = cells[cells['contestant'].isin(('paper', 'bridge')) & has_memory.astype(bool)]
    chosen = cells[cells['load'].isin(_MEMORY_LOADS)]
    cells = cells if chosen.empty else chosen
    loads = list(cells['load'].unique())[:_MOST_PANELS]
    if not loads:
        return None
    figure, panels = _panels(2, len(loads), 2.6, sharey='row', sharex='col')
    for place, axes in enumerate(panels):
        side, load = ('kafka_ros', 'ros_kafka')[place // len(loads)], loads[place % len(loads)]
        for name, one in _by_contestant(cells[cells['load'] == load]):
            usage = getattr(one['result'].iloc[0], side)
            _line(axes, name, usage.seconds, usage.memory_mib, f'{name}-{side}-{load}')
            axes.set_title(one.index[0][0] if side == 'kafka_ros' else '')
    # After all lines: a limit that is set ends the scaling of those that share the axis.
    for axes, label in ((panels[0], 'Kafka-ROS, MiB'), (panels[len(loads)], 'ROS-Kafka, MiB')):
        axes.set_ylim(bottom=0)
        axes.set_ylabel(label)
    figure.supxlabel('seconds', fontsize=9)
    _legend(figure, cells)
    return figure


def _throughput(cells: pd.DataFrame) -> Figure | None:
    """Delivered against offered, of all loads but bursts."""
    cells = cells[(cells['burst_orders'] == 1) & (cells['sent_orders_per_s'] > 0)]
    if cells.empty:
        return None
    figure, (axes,) = _panels(1, 1, 4.6)
    ends = cells['sent_orders_per_s'].min() / 1.5, cells['sent_orders_per_s'].max() * 1.5
    axes.plot(ends, ends, **_FAINT, gid='all-of-it', label='all of it')
    for name, ones in _by_contestant(cells.sort_values('sent_orders_per_s')):
        came = ones['delivered_orders_per_s'].clip(lower=0.01)
        line = _line(axes, name, ones['sent_orders_per_s'], came, name)
        line.set(marker=contestant(name).marker)
        line.set_label(f'{ones.index[0][1]}: {digits(came.max())}/s at most')
    axes.set(xscale='log', yscale='log', xlim=ends)
    axes.set(xlabel='orders/s offered', ylabel='orders/s delivered')
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter('{x:,g}')
    axes.legend(loc='upper left')
    return figure


def _predicted(predictions: Sequence[Prediction]) -> Figure | None:
    """A panel for each depth; on the line the loss predicted is that measured."""
    if not predictions:
        return None
    depths = sorted({one.depth for one in predictions})
    figure, panels = _panels(1, len(depths), 4.3, sharey=True)
    for depth, axes in zip(depths, panels, strict=True):
        axes.plot([0, 100], [0, 100], **_FAINT, gid=f'identity-{depth}')
        ones = [one for one in predictions if one.depth == depth]
        measured, loss, low, high = (
            100 * np.array([(one.measured, one.loss, one.low, one.high) for one in ones]).T
        )
        errors = np.maximum(0, [loss - low, high - loss])
        bars = axes.errorbar(
            measured, loss, errors,
            color=contestant('paper').colour, marker='o', linestyle='', capsize=3, clip_on=False,
        )  # fmt: skip
        bars.lines[0].set_gid(f'depth-{depth}')
        # The loads of which nothing was lost all lie on one point.
        for x, y, one in zip(measured, loss, ones, strict=True):
            if max(x, y) > 0.01:
                axes.annotate(one.load.name, (x, y), (6, -9), textcoords='offset points')
        _root_axes(axes)
        axes.set(title=f'depth {depth}', xlabel='loss measured')
    panels[0].set_ylabel('loss predicted')
    return figure


def _root_axes(axes: Axes) -> None:
    """Give small losses room."""
    roots = (lambda values: np.sqrt(np.maximum(values, 0)), np.square)
    ticks = [0, 1, 5, 20, 50, 100]
    axes.set_xscale('function', functions=roots)
    axes.set_yscale('function', functions=roots)
    axes.set_xticks(ticks, [f'{tick} %' for tick in ticks])
    axes.set_yticks(ticks, [f'{tick} %' for tick in ticks])
    axes.set(xlim=(0, 100), ylim=(0, 100))


# What all have in common


def _panels(down: int, across: int, height: float, **shared: Any) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure((_WIDTH, height * down), layout='constrained')
    return figure, list(figure.subplots(down, across, squeeze=False, **shared).flat)


def _by_contestant(cells: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for name, ones in cells.groupby('contestant', sort=False):
        yield str(name), ones


def _line(axes: Axes, name: str, x: npt.ArrayLike, y: npt.ArrayLike, gid: str) -> Line2D:
    """The line of a contestant; ours lies above the others but the dotted one of bare loops."""
    look = contestant(name)
    order = {'bridge': 4.0, 'bare': 5.0}.get(name, 3.0)
    return axes.plot(
        x, y, color=look.colour, linestyle=look.line, zorder=order, clip_on=False, gid=gid
    )[0]


def _legend(figure: Figure, cells: pd.DataFrame, *more: Line2D) -> None:
    """Name the lines, above the panels."""
    looks = [contestant(name) for name in cells['contestant'].unique()]
    lines = [
        Line2D([], [], color=look.colour, linestyle=look.line, label=look.title) for look in looks
    ]
    figure.legend(handles=[*lines, *more], loc='outside upper left', ncols=len(lines) + len(more))


def _svg(name: str, figure: Figure) -> str:
    """Make it fit into a page: identifiers of its own, no prologue."""
    buffer = io.StringIO()
    figure.savefig(buffer, format='svg', metadata=dict(_NO_DATE))
    svg = buffer.getvalue()
    svg = re.sub(r'<metadata>.*?</metadata>\s*', '', svg[svg.index('<svg') :], flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    return re.sub(r'(url\(#|href="#)', rf'\g<1>{name}-', svg)
