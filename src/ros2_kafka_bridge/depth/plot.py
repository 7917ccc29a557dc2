"""The picture of an answer: the loss against the depth, and the queue over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ros2_kafka_bridge.depth.choice import Choice, Fitted, Prediction, fitted, predict
from ros2_kafka_bridge.depth.queue import Times, replay
from ros2_kafka_bridge.errors import ConfigError

_DEPTHS = 40
_POINTS = 2000
_LEAST = 1e-12
_BLUE, _ORANGE, _GREY = '#1f5fa8', '#d9731a', '#666666'


def draw(
    file: Path,
    where: str,
    arrivals_ns: Times,
    service_ns: Times | int,
    wake_ns: Times | int,
    choice: Choice,
) -> None:
    """Draw an answer into a file; its suffix says the format (.png, .svg, .pdf).

    What it was chosen by are the arguments of `choose`.

    Raises:
        ConfigError: The file cannot be written.
    """
    depths = _depths(choice)
    predictions = predict(arrivals_ns, service_ns, depths, choice.confidence, wake_ns=wake_ns)
    figure = Figure(figsize=(9, 7.5), layout='constrained')  # without pyplot: no window, no state
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    _draw_loss(above, predictions, choice)
    _draw_queue(below, fitted(arrivals_ns, service_ns, wake_ns), choice)
    figure.suptitle(f'{where}: which KEEP_LAST depth')
    try:
        figure.savefig(file, dpi=150)
    except OSError as error:
        raise ConfigError([f'--plot {file}: {error.strerror}']) from error


def _depths(choice: Choice) -> list[int]:
    """From 1 to a little beyond all that matters, closer together where it is small."""
    named = [choice.recommended, choice.estimated, choice.load.peak, 10]
    last = max(depth for depth in named if depth is not None) * 1.2 + 5
    return sorted({int(depth) for depth in np.geomspace(1, last, _DEPTHS)})


def _draw_loss(axes: Axes, predictions: list[Prediction], choice: Choice) -> None:
    depth = np.array([p.depth for p in predictions])
    loss = np.array([p.loss for p in predictions])
    low = np.array([p.low for p in predictions])
    high = np.array([p.high for p in predictions])
    replayed = np.array([p.replayed for p in predictions])
    axes.fill_between(
        depth,
        np.maximum(low, _LEAST),
        np.maximum(high, _LEAST),
        color=_BLUE,
        alpha=0.18,
        linewidth=0,
        label=f'{choice.confidence:.0%} interval',
    )
    axes.plot(depth, np.maximum(loss, _LEAST), color=_BLUE, label='estimate')
    axes.plot(
        depth[replayed > 0], replayed[replayed > 0], 'o', color=_BLUE, ms=4, label='replayed'
    )
    axes.axhline(choice.loss, color=_ORANGE, linestyle='--', label=f'wanted: {choice.loss:g}')
    if choice.recommended is not None:
        axes.axvline(
            choice.recommended, color=_ORANGE, label=f'recommended: {choice.recommended:,}'
        )
    axes.set(
        xscale='log' if depth[-1] > 1000 else 'linear',
        yscale='log',
        ylim=(max(_LEAST, choice.loss / 100), 1.0),
        xlim=(1, depth[-1]),
        xlabel='depth (messages)',
        ylabel='share of messages lost',
    )
    axes.grid(alpha=0.3)
    axes.legend(loc='upper right')


def _draw_queue(axes: Axes, recorded: Fitted, choice: Choice) -> None:
    arrivals, service, wake = recorded
    waiting = replay(arrivals, service, None, wake).waiting
    # The highest of each stretch: a picture has fewer points than a recording has peaks.
    begins = np.unique(np.linspace(0, len(waiting), _POINTS, endpoint=False).astype(int))
    seconds = (arrivals[begins] - arrivals[0]) / 1e9
    axes.plot(seconds, np.maximum.reduceat(waiting, begins), color=_GREY, linewidth=0.8)
    if choice.recommended is not None and choice.recommended <= 5 * max(1, choice.load.peak):
        axes.axhline(choice.recommended, color=_ORANGE)
    axes.set(
        xlabel='time (s)',
        ylabel='waiting in an endless queue\n(messages)',
        ylim=(0, None),
        xlim=(0, max(1e-9, float(seconds[-1]))),
    )
    axes.grid(alpha=0.3)
