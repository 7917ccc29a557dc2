"""The plots, as SVG that is the same for the same numbers."""

import html
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from benchmarks.experiment.report.blocks import Plot
from benchmarks.experiment.report.contestants import contestant
from benchmarks.experiment.report.found import Found, Run
from benchmarks.experiment.report.numbers import digits
from benchmarks.experiment.report.paper import RATES, TABLES, published
from benchmarks.experiment.results import SHARES, Load, Prediction, Result, Usage

_STYLE: Final[dict[Any, Any]] = {
    'svg.fonttype': 'none',
    'svg.hashsalt': 'experiment',
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans', 'Verdana', 'Arial', 'sans-serif'],
    'font.size': 9.0,
    'axes.titlesize': 9.5,
    'axes.titlelocation': 'left',
    'axes.titleweight': 'bold',
    'axes.labelsize': 9.0,
    'axes.labelcolor': '#333333',
    'axes.edgecolor': '#8a8a8a',
    'axes.linewidth': 0.8,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.unicode_minus': True,
    'grid.color': '#e4e4e4',
    'grid.linewidth': 0.8,
    'xtick.color': '#8a8a8a',
    'ytick.color': '#8a8a8a',
    'xtick.labelcolor': '#333333',
    'ytick.labelcolor': '#333333',
    'xtick.labelsize': 8.0,
    'ytick.labelsize': 8.0,
    'lines.linewidth': 1.8,
    'lines.markersize': 4.5,
    'legend.frameon': False,
    'figure.facecolor': 'white',
    'axes.facecolor': 'white',
}
_WIDTH: Final = 11.0  # inches, of every plot
_GREY: Final = '#8a8a8a'
_NO_DATE: Final = {'Date': None, 'Creator': None, 'Format': None, 'Type': None}
# Loads at which a picture says most, in addition to the paper's.
_FASTER: Final = ('1000', '5000')
_MEMORY_LOADS: Final = ('160', '5000', '20000', 'max', 'bursts')
_MOST_PANELS: Final = 4


def plots(found: Found) -> Mapping[str, Plot]:
    """Draw all for which there is something to be drawn, by name."""
    makers = (_loss, _latency, _memory, _throughput, _predicted)
    with mpl.rc_context(_STYLE):
        made = [maker(found) for maker in makers]
    return {plot.name: plot for plot in made if plot is not None}


# Loss against load


def _loss(found: Found) -> Plot | None:
    """A panel for each depth; those that have no depth are in all of them."""
    depths = sorted({run.depth for run in found.runs if run.depth is not None}) or [0]
    if not found.runs:
        return None
    figure = Figure((_WIDTH, 4.0), layout='constrained')
    panels = figure.subplots(1, len(depths), sharey=True, squeeze=False)[0]
    places = _load_places(found.loads)
    for depth, axes in zip(depths, panels, strict=True):
        shown = [run for run in found.runs if run.depth in {None, depth}]
        for run in shown:
            _loss_line(axes, found, run, places, depth)
        axes.set_title(f'depth {depth}' if depth else 'no depth')
        _load_axis(axes, found.loads, places)
        axes.set_yscale('symlog', linthresh=0.1, linscale=0.5)
        axes.set_ylim(-0.02, 140)
        axes.yaxis.set_major_locator(FixedLocator([0, 0.1, 1, 10, 100]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g} %'))
    panels[0].set_ylabel('orders lost')
    _legend(figure, [run.contestant for run in found.runs])
    return _plot(
        figure,
        'loss',
        'Orders lost against the load, for each depth of KEEP_LAST. Ours and the bare loops have '
        'no depth and are the same in each panel.',
        'Share of the orders lost, on a scale that is linear up to 0.1 %, against orders per '
        'second on a logarithmic scale; sending as fast as possible and bursts at the right.',
    )


def _loss_line(
    axes: Axes, found: Found, run: Run, places: Mapping[str, float], depth: int
) -> None:
    look = contestant(run.contestant)
    results = [found.at(run, load.name) for load in found.loads]
    points = [
        (places[one.cell.load.name], 100 * one.counts.loss, _is_even(one.cell.load))
        for one in results
        if one is not None and one.counts.producer
    ]
    even = [point for point in points if point[2]]
    axes.plot(
        [x for x, *_ in even], [y for _, y, _ in even],
        color=look.colour, linestyle=look.line, gid=f'{run.contestant}-{depth}',
        clip_on=False, zorder=_order(run.contestant),
    )  # fmt: skip
    axes.plot(
        [x for x, *_ in points], [y for _, y, _ in points],
        color=look.colour, linestyle='', marker=look.marker, clip_on=False,
        gid=f'{run.contestant}-{depth}-points', zorder=7.0 if run.contestant == 'bridge' else 6.0,
    )  # fmt: skip


def _load_places(loads: Sequence[Load]) -> Mapping[str, float]:
    """Where each load stands: by its rate, those without an even one at the right."""
    rates = [load.rate for load in loads if _is_even(load)]
    last = max(rates, default=1.0)
    places = {load.name: load.rate for load in loads if _is_even(load)}
    for number, load in enumerate(load for load in loads if not _is_even(load)):
        places[load.name] = last * 10 ** (0.55 * (number + 1))
    return places


def _is_even(load: Load) -> bool:
    return load.rate > 0 and load.burst == 1


def _load_axis(axes: Axes, loads: Sequence[Load], places: Mapping[str, float]) -> None:
    axes.set_xscale('log')
    axes.xaxis.set_major_locator(FixedLocator([places[load.name] for load in loads]))
    axes.xaxis.set_minor_locator(NullLocator())
    labels = [digits(load.rate, 2) if _is_even(load) else load.name for load in loads]
    axes.set_xticklabels(labels, rotation=50, ha='right', rotation_mode='anchor')
    axes.set_xlabel('orders/s')
    rates = [places[load.name] for load in loads if _is_even(load)]
    if rates and len(rates) < len(loads):
        axes.axvline(max(rates) * 10**0.28, color=_GREY, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set_xlim(min(places.values()) / 1.6, max(places.values()) * 1.6)


# Latency


def _latency(found: Found) -> Plot | None:
    names = [*RATES, *_FASTER]
    loads = [load for load in found.loads if load.name in names]
    runs = _shallowest(found)
    loads = [load for load in loads if any(_curve(found.at(run, load.name)) for run in runs)]
    if not loads:
        return None
    across = min(3, len(loads) + 1)
    down = math.ceil((len(loads) + 1) / across)
    figure = Figure((_WIDTH, 2.9 * down), layout='constrained')
    panels = list(figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).flat)
    for load, axes in zip(loads, panels, strict=False):
        for run in runs:
            _latency_line(axes, run, load, found.at(run, load.name))
        _published_marks(axes, load)
        axes.set_title(load.words)
        _quantile_axis(axes)
        axes.set_yscale('log')
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: digits(value)))
        axes.yaxis.set_minor_formatter(NullFormatter())
    for number, axes in enumerate(panels[: len(loads)]):
        # The panel below may be the one without axes.
        axes.tick_params(labelbottom=number + across >= len(loads))
        if number % across == 0:
            axes.set_ylabel('latency, ms')
        if number + across >= len(loads):
            axes.set_xlabel('share of the orders that came')
    for axes in panels[len(loads) :]:
        axes.set_axis_off()
    marks = [Line2D([], [], color=_GREY, linewidth=1.2, linestyle=(0, (1, 1)))]
    words = ['published: fastest and\nslowest order']
    _legend(figure, [run.contestant for run in runs], panels[len(loads)], marks, words)
    depth = next((run.depth for run in runs if run.depth is not None), None)
    said = '' if depth is None else f' Those with KEEP_LAST have depth {depth}.'
    return _plot(
        figure,
        'latency',
        f'How long the orders took: at each share, the latency that so many kept within.{said} '
        'What was lost is not in it.',
        'Quantile curves of latency in milliseconds on a logarithmic scale, one panel for each '
        'load.',
    )


def _shallowest(found: Found) -> Sequence[Run]:
    """Each contestant once, with its smallest depth."""
    runs: dict[str, Run] = {}
    for run in found.runs:
        runs.setdefault(run.contestant, run)
    return list(runs.values())


def _curve(result: Result | None) -> Sequence[float]:
    """Its quantiles; none where they are not those at `SHARES`."""
    curve = result.latency.curve if result and result.latency else ()
    return curve if len(curve) == len(SHARES) else ()


def _nines(share: float) -> float:
    """Where a share stands on an axis that gives each further nine the same room."""
    return -math.log10(max(1 - share, 10**-4.7))


def _quantile_axis(axes: Axes) -> None:
    shares = (0.0, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0)
    axes.xaxis.set_major_locator(FixedLocator([_nines(share) for share in shares]))
    axes.set_xticklabels(
        ['', *(f'{100 * share:g} %' for share in shares[1:])], rotation=35, ha='right'
    )
    axes.set_xlim(0, _nines(1.0))


def _latency_line(axes: Axes, run: Run, load: Load, result: Result | None) -> None:
    curve = _curve(result)
    if not curve:
        return
    look = contestant(run.contestant)
    axes.plot(
        [_nines(share) for share in SHARES], curve,
        color=look.colour, linestyle=look.line, gid=f'{run.contestant}-{load.name}',
        zorder=_order(run.contestant),
    )  # fmt: skip


def _published_marks(axes: Axes, load: Load) -> None:
    ones = [one for depth in TABLES.values() if (one := published(load.name, depth))]
    if not ones:
        return
    fastest, slowest = ones[0].fastest_s, ones[0].slowest_s
    for seconds, name in ((fastest, 'fastest'), (slowest, 'slowest')):
        axes.axhline(
            1000 * seconds, color=_GREY, linewidth=1.2, linestyle=(0, (1, 1)),
            gid=f'published-{name}-{load.name}',
        )  # fmt: skip


# Memory


def _memory(found: Found) -> Plot | None:
    runs = [run for run in _shallowest(found) if run.contestant in {'paper', 'bridge'}]
    loads = [
        load
        for load in _by_name(found.loads, _MEMORY_LOADS) or found.loads
        if any(_has_memory(found.at(run, load.name)) for run in runs)
    ][:_MOST_PANELS]
    if not loads:
        return None
    figure = Figure((_WIDTH, 5.2), layout='constrained')
    panels = figure.subplots(2, len(loads), sharey='row', sharex='col', squeeze=False)
    sides: Sequence[tuple[str, str, Callable[[Result], Usage]]] = (
        ('kafka_ros', 'Kafka-ROS, MiB', lambda result: result.kafka_ros),
        ('ros_kafka', 'ROS-Kafka, MiB', lambda result: result.ros_kafka),
    )
    for row, (side, words, usage) in zip(panels, sides, strict=True):
        for axes, load in zip(row, loads, strict=True):
            for run in runs:
                _memory_line(axes, run, found.at(run, load.name), usage, f'{side}-{load.name}')
        # After all lines: a limit that is set ends the scaling of those that share the axis.
        row[0].set_ylim(bottom=0)
        row[0].set_ylabel(words)
    for axes, load in zip(panels[0], loads, strict=True):
        axes.set_title(load.words)
    for axes in panels[1]:
        axes.set_xlabel('seconds')
    _legend(figure, [run.contestant for run in runs])
    return _plot(
        figure,
        'memory',
        'Anonymous memory of the two processes from the first order on.',
        'Memory in MiB over time, one row for each of the two bridges, one column for each load.',
    )


def _by_name(loads: Iterable[Load], names: Sequence[str]) -> Sequence[Load]:
    return [load for load in loads if load.name in names]


def _has_memory(result: Result | None) -> bool:
    return result is not None and bool(result.kafka_ros.memory_mib or result.ros_kafka.memory_mib)


def _memory_line(
    axes: Axes,
    run: Run,
    result: Result | None,
    usage: Callable[[Result], Usage],
    name: str,
) -> None:
    if result is None:
        return
    used = usage(result)
    look = contestant(run.contestant)
    axes.plot(
        used.seconds, used.memory_mib,
        color=look.colour, linestyle=look.line, gid=f'{run.contestant}-{name}',
    )  # fmt: skip


# Throughput


def _throughput(found: Found) -> Plot | None:
    runs = _shallowest(found)
    even = [load for load in found.loads if load.burst == 1]
    lines = [
        (run, [one for load in even if (one := found.at(run, load.name)) and one.sent_per_s > 0])
        for run in runs
    ]
    offered = [one.sent_per_s for _, results in lines for one in results]
    if not offered:
        return None
    figure = Figure((_WIDTH, 4.6), layout='constrained')
    axes = figure.subplots()
    ends = [min(offered) / 1.5, max(offered) * 1.5]
    axes.plot(ends, ends, color=_GREY, linewidth=0.9, linestyle=(0, (4, 3)), gid='all-of-it')
    limits = []
    for run, results in lines:
        look = contestant(run.contestant)
        points = sorted((one.sent_per_s, max(one.delivered_per_s, 0.01)) for one in results)
        axes.plot(
            [x for x, _ in points], [y for _, y in points], clip_on=False,
            color=look.colour, linestyle=look.line, marker=look.marker,
            gid=run.contestant, zorder=_order(run.contestant),
        )  # fmt: skip
        if points:
            limit = max(y for _, y in points)
            limits.append(_Label(limit, f'{run.title}: {digits(limit)}/s at most', look.colour))
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_xlim(*ends)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: digits(value)))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel('orders/s offered')
    axes.set_ylabel('orders/s delivered')
    axes.set_title('delivered against offered; dashed: all of it')
    _label_right(axes, limits)
    return _plot(
        figure,
        'throughput',
        'Orders delivered against orders offered, with the most that each contestant delivered. '
        'Bursts are left out.',
        'Delivered orders per second against offered orders per second, both on a logarithmic '
        'scale, with the line at which all is delivered.',
    )


class _Label(NamedTuple):
    """Words beside the end of a line, at its height."""

    y: float
    words: str
    colour: str


def _label_right(axes: Axes, labels: Sequence[_Label]) -> None:
    """Write at the right of the plot, each at its height, moved apart where they would touch."""
    low, high = axes.get_ylim()
    span = math.log10(high / low)
    ordered = sorted(labels, key=lambda label: label.y)
    wanted = [math.log10(label.y / low) / span for label in ordered]
    heights: list[float] = []
    for height in wanted:
        heights.append(max(height, heights[-1] + 0.06) if heights else height)
    over = max(0.0, heights[-1] - 1.0) if heights else 0.0
    for label, height in zip(ordered, heights, strict=True):
        axes.annotate(
            label.words, (1.01, height - over), xycoords='axes fraction',
            color=label.colour, va='center', annotation_clip=False,
        )  # fmt: skip


# Predicted and measured


def _predicted(found: Found) -> Plot | None:
    predictions = found.experiment.predictions
    if not predictions:
        return None
    depths = sorted({one.depth for one in predictions})
    figure = Figure((_WIDTH, 4.3), layout='constrained')
    panels = figure.subplots(1, len(depths), sharex=True, sharey=True, squeeze=False)[0]
    for depth, axes in zip(depths, panels, strict=True):
        ones = [one for one in predictions if one.depth == depth]
        axes.plot([0, 100], [0, 100], color=_GREY, linewidth=0.9, gid=f'identity-{depth}')
        bars = axes.errorbar(
            [100 * one.measured for one in ones],
            [100 * one.loss for one in ones],
            yerr=list(zip(*(_bars(one) for one in ones), strict=True)),
            color=contestant('paper').colour, marker='o', linestyle='', capsize=3,
            elinewidth=1.2, clip_on=False,
        )  # fmt: skip
        bars.lines[0].set_gid(f'depth-{depth}')
        _name_points(axes, ones)
        axes.set_title(f'depth {depth}')
        axes.set_xlabel('loss measured')
        _root_axes(axes)
    panels[0].set_ylabel('loss predicted')
    return _plot(
        figure,
        'predicted',
        'Loss predicted from a recording, with its 95 % interval, against the loss measured. On '
        'the line the two are the same. The scales are square roots, so that small losses show.',
        'Predicted against measured loss, one panel for each depth.',
    )


def _bars(one: Prediction) -> tuple[float, float]:
    return 100 * max(0.0, one.loss - one.low), 100 * max(0.0, one.high - one.loss)


def _root_axes(axes: Axes) -> None:
    """Give small losses room, and those near all of it, too."""
    for axis, scale, limit in (
        (axes.xaxis, axes.set_xscale, axes.set_xlim),
        (axes.yaxis, axes.set_yscale, axes.set_ylim),
    ):
        scale('function', functions=(_root, np.square))
        limit(0, 100)
        axis.set_major_locator(FixedLocator([0, 1, 5, 20, 50, 100]))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g} %'))


def _root(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.sqrt(np.maximum(values, 0))


def _name_points(axes: Axes, ones: Sequence[Prediction]) -> None:
    """Name the loads of which something was lost; the others all lie on one point."""
    lossy = [one for one in ones if max(one.measured, one.loss) > 0.0001]
    for number, one in enumerate(sorted(lossy, key=lambda one: one.measured)):
        left = number % 2 == 0
        axes.annotate(
            one.load.name, (100 * one.measured, 100 * one.loss), (-7, 4) if left else (7, -9),
            textcoords='offset points', ha='right' if left else 'left', color='#333333',
            fontsize=8,
        )  # fmt: skip


# What all have in common


def _order(name: str) -> float:
    """Ours lies above the others; the dotted line of bare loops lets it be seen below."""
    return {'bridge': 4.0, 'bare': 5.0}.get(name, 3.0)


def _legend(
    figure: Figure,
    names: Iterable[str],
    axes: Axes | None = None,
    marks: Sequence[Line2D] = (),
    words: Sequence[str] = (),
) -> None:
    """Name the lines, above the panels or in the room of one that is free."""
    looks = [contestant(name) for name in dict.fromkeys(names)]
    lines = [
        Line2D(
            [], [], color=look.colour, linestyle=look.line,
            marker='' if axes else look.marker,
        )
        for look in looks
    ]  # fmt: skip
    titles = [look.title for look in looks]
    if axes is None:
        figure.legend(
            [*lines, *marks], [*titles, *words], loc='outside upper left', ncols=len(lines)
        )
    else:
        axes.legend([*lines, *marks], [*titles, *words], loc='center left', fontsize=9.5)


def _plot(figure: Figure, name: str, caption: str, says: str) -> Plot:
    buffer = io.StringIO()
    figure.savefig(buffer, format='svg', metadata=dict(_NO_DATE))
    return Plot(name, caption, says, _embeddable(buffer.getvalue(), name, says))


def _embeddable(svg: str, name: str, says: str) -> str:
    """Make it fit into a page: identifiers of its own, no prologue, words for who cannot see."""
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'<metadata>.*?</metadata>\s*', '', svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'(url\(#|href="#)', rf'\g<1>{name}-', svg)
    label = html.escape(says, quote=True)
    return svg.replace('<svg ', f'<svg role="img" aria-label="{label}" ', 1)
