"""`depth`: which KEEP_LAST depth a reader needs, from what is asked to what is shown."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING, Any

from ros2_kafka_bridge.commands.screen import screen, show_line, show_notes, show_table, waiting
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.outside.extras import missing_extra

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.console import Console

    from ros2_kafka_bridge.commands.depth.options import DepthOptions
    from ros2_kafka_bridge.commands.depth.sources import Traffic
    from ros2_kafka_bridge.depth.choice import Choice, Prediction

_PICTURES = ('.png', '.svg', '.pdf')
_LEAST_SHOWN = 1e-15
_HOW_TO_RECORD = (
    'wrap the callback of the subscription with ros2_kafka_bridge.depth.ServiceTimes '
    '(docs/depth.md)'
)


def report(options: DepthOptions) -> int:
    """Find the depth and show it.

    Returns:
        0 when a depth was found, 1 when none can be named.

    Raises:
        BridgeError: What is asked for is not complete, or cannot be read.
    """
    _check(options)
    _import_extra(plots=options.plot is not None)
    keep_clients_quiet()

    from ros2_kafka_bridge.commands.depth.sources import measured  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.depth.choice import choose  # noqa: PLC0415 (scipy is heavy)

    traffic, reader = measured(options)
    times = traffic.arrivals_ns
    if not len(times) or times[0] == times[-1]:
        number = f'{count(len(times), "message")}{" of one moment" if len(times) else ""}'
        why = 'it takes two times at least, and 1000 messages to say much'
        raise ConfigError([f'{traffic.where}: {number}, of which no depth can be told: {why}'])
    with waiting('Replaying'):
        service, wake = reader.service_ns, reader.wake_ns
        choice = choose(times, service, options.loss, depths=options.depths, wake_ns=wake)
    choice = choice._replace(notes=(*traffic.notes, *reader.notes, *choice.notes))
    if options.as_json:
        sys.stdout.write(json.dumps(_as_json(traffic, choice), indent=2) + '\n')
    else:
        _show(screen(), traffic, choice)
    if options.plot is not None:
        from ros2_kafka_bridge.depth.plot import draw  # noqa: PLC0415 (matplotlib is heavy)

        draw(options.plot, traffic.where, times, service, wake, choice)
        if not options.as_json:
            show_line(screen(), f'drawn: {options.plot}')
    return 1 if choice.recommended is None else 0


def _check(options: DepthOptions) -> None:
    """Refuse what is not one source of arrivals and one of service times."""
    problems = []
    sources = {
        '--kafka': options.kafka,
        '--ros': options.ros,
        '--arrivals': options.arrivals,
        '--recording': options.recording,
    }
    given = [name for name, value in sources.items() if value is not None]
    if len(given) != 1:
        found = ' and '.join(given) or 'none'
        problems.append(f'arrivals: one of {", ".join(sources)} is needed, not {found}')
    ways = {'--service': options.service, '--service-file': options.service_file}
    services = [name for name, value in ways.items() if value]
    if len(services) > 1 or (services and options.recording):
        both = ' and '.join([*services, *(['--recording'] if options.recording else [])])
        problems.append(f'service times: {both} each say them: leave all but one out')
    elif not services and not options.recording:
        problems.append(
            'service times: --service (as 0.8ms) or --service-file is needed: how long your '
            f'reader takes for a message; to measure it, {_HOW_TO_RECORD}'
        )
    if not 0 < options.loss < 1:
        problems.append(f'--loss: {options.loss:g} is not above 0 and below 1')
    if any(depth < 1 for depth in options.depths):
        problems.append('--depth: a depth is 1 or more')
    if options.plot is not None:
        problems += [f'--plot {options.plot}: {why}' for why in _plot_problems(options.plot)]
    if problems:
        raise ConfigError(problems)


def _plot_problems(file: Path) -> Iterator[str]:
    """What would keep the picture from being written, once everything is measured."""
    if file.suffix not in _PICTURES:
        yield f'use a name that ends in {", ".join(_PICTURES)}'
    if not os.path.isdir(file.parent):  # noqa: PTH112 (that of a path can raise)
        yield f'there is no directory {file.parent}'


def _import_extra(*, plots: bool) -> None:
    """Say in a sentence that the extra is missing, before anything is waited for."""
    try:
        import scipy.stats  # noqa: F401, PLC0415 (perhaps not there)

        if plots:
            import matplotlib as mpl  # noqa: F401, PLC0415
    except ImportError as error:
        problem = missing_extra('depth') or f'depth cannot be loaded: {error}'
        raise ConfigError([problem]) from error


def _as_json(traffic: Traffic, choice: Choice) -> dict[str, Any]:
    return {
        'arrivals': traffic.where,
        **choice._asdict(),
        'load': choice.load._asdict(),
        'predictions': [prediction._asdict() for prediction in choice.predictions],
    }


def _show(console: Console, traffic: Traffic, choice: Choice) -> None:
    load = choice.load
    wake_ms = load.wake_seconds * 1e3
    wake = f', and begins {wake_ms:.3g} ms after a message that meets it idle' if wake_ms else ''
    show_line(
        console,
        f'{traffic.where}: {load.messages:,} messages in {load.seconds:,.1f} s, {load.rate:,.1f} '
        f'a second; the reader is busy {load.utilisation:.1%} of the time{wake}; at most '
        f'{load.peak:,} waited at once',
    )
    outside = f'{choice.confidence:.0%} interval'
    title = f'Loss by depth (wanted: {choice.loss:g})'
    rows = [_row(prediction, choice) for prediction in choice.predictions]
    columns = ['#depth', '#loss', f'#{outside}', 'how it is known', 'answer']
    show_table(console, title, columns, rows)
    show_notes(console, choice.notes)
    if choice.recommended is None:
        show_line(console, 'No depth can be recommended.', 'bold red')
    else:
        show_line(console, f'Recommended: KEEP_LAST, depth {choice.recommended}', 'bold green')


def _row(prediction: Prediction, choice: Choice) -> list[list[str]]:
    depth = prediction.depth
    mark = ''
    if depth == choice.recommended:
        mark = f'recommended: even the upper end is at most {choice.loss:g}'
    elif depth == choice.estimated:
        mark = f'the estimate is at most {choice.loss:g}'
    known = 'replayed' if prediction.seen else 'estimated, beyond what was seen'
    if prediction.replayed and not prediction.seen:
        known = 'estimated, few were lost in the replay'
    interval = f'{_share(prediction.low)} to {_share(prediction.high)}'
    return [[f'{depth:,}'], [_share(prediction.loss)], [interval], [known], [mark]]


def _share(share: float) -> str:
    """A share that people can read: percents, and below those the power of ten."""
    if share >= 0.0001:
        return f'{share:.2%}'
    if 0 < share < _LEAST_SHOWN:
        return f'< {_LEAST_SHOWN:g}'
    return f'{share:.0e}'.replace('e-0', 'e-') if share else '0'
