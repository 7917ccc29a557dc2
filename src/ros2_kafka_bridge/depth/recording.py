"""Files of arrivals and of service times, read and checked."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ros2_kafka_bridge.depth.queue import Times
from ros2_kafka_bridge.depth.recorder import HEADER
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.text import count

_NEVER_WAITED = (
    'no message ever waited while this was recorded: what the executor does between two callbacks '
    'was not seen, and is missing in the service times'
)


SIZE_LIMIT_BYTES = 256 * 1024 * 1024
"""Of a file of times: some ten million of them, which take some gigabytes to look at."""

_SHOWN_CHARS = 40
_LONGEST_WAKE_NS = 100_000_000
_MOST_WRONG = 0.05
_MS = 1e6


class Reader(NamedTuple):
    """How fast a reader is.

    Args:
        service_ns: How long it is busy with a message: of each one served, or one number.
        wake_ns: How long it takes to begin with a message that meets it idle: of each such
            message, or one number.
        notes: What is to be known of it, a sentence each.
    """

    service_ns: Times | int
    wake_ns: Times | int
    notes: tuple[str, ...]


class Recording(NamedTuple):
    """What was recorded of a reader.

    Args:
        arrivals_ns: When each message was published, in order; those that never came to the
            callback are filled in.
        service_ns: How long the reader was busy with each message that it served.
        wake_ns: How long it took to begin with each message that met it idle, one at least.
        notes: What is to be known of it, a sentence each.
    """

    arrivals_ns: Times
    service_ns: Times
    wake_ns: Times
    notes: tuple[str, ...]


def read_arrivals(file: Path) -> Times:
    """Read times of arrival: nanoseconds, one a line, not decreasing; `#` begins a comment.

    A file of `ServiceTimes` is read, too.

    Raises:
        ConfigError: The file is not there, or not such a file.
    """
    if _is_recording(file):
        return read_recording(file).arrivals_ns
    times = _column(file, 'a time in nanoseconds, one a line')
    behind = np.flatnonzero(np.diff(times) < 0)
    if len(behind):
        text = (
            f'{file}: time {behind[0] + 2} of {len(times)} is earlier than the one '
            f'before it: sort the file (sort -n {file})'
        )
        raise ConfigError([text])
    return times


def read_service(file: Path) -> Reader:
    """Read service times, of `ServiceTimes` or nanoseconds one a line.

    Raises:
        ConfigError: The file is not there, or not such a file.
    """
    if _is_recording(file):
        _, service, wake, notes = read_recording(file)
        return Reader(service, wake, notes)
    times = _column(file, 'a service time in nanoseconds, one a line')
    if times.min() < 0:
        raise ConfigError([f'{file}: a service time is negative'])
    return Reader(times, 0, ())


def read_recording(file: Path) -> Recording:
    """Read what `ServiceTimes` has written.

    Raises:
        ConfigError: The file is not there, or not such a file, or two callbacks ran at once.
    """
    if not _is_recording(file):
        raise ConfigError(
            [f'{file}: is no recording of ros2_kafka_bridge.depth.ServiceTimes: use --arrivals']
        )
    rows = _rows(file)
    arrivals, starts, ends, missed = rows.T
    _check_one_at_a_time(file, starts, ends)
    due = _due(arrivals, missed)
    waited = np.append(False, due[1:] <= ends[:-1])
    service, notes = _service(starts, ends, waited[1:])
    wake, warnings = _wake(file, (starts - due)[~waited])
    notes += warnings
    order = np.argsort(arrivals, kind='stable')
    filled = _filled(arrivals[order], missed[order])
    if lost := int(missed.sum()):
        notes += (
            (
                f'{count(lost, "message")} never came to the callback while it was recorded, and '
                'are filled in evenly: record with KEEP_ALL, or a larger depth'
            ),
        )
    return Recording(filled, service, wake, notes)


def _due(arrivals: Times, missed: Times) -> Times:
    """For each message, when the first one arrived that could have been taken in its place.

    Where a full queue pushed messages out, they are what waited, or woke the reader: the one that
    was taken may have come long after.
    """
    first = arrivals[:-1] + np.diff(arrivals) // (missed[1:] + 1)
    return np.append(arrivals[:1], np.minimum(first, arrivals[1:]))


def _service(
    starts: Times, ends: Times, waited: npt.NDArray[np.bool_]
) -> tuple[Times, tuple[str, ...]]:
    """How long the reader was busy with each message.

    From start to start where the next message waited already: what the executor does between two
    callbacks keeps the reader busy, too. Else the callback and what is usual between two.
    """
    between = starts[1:] - ends[:-1]
    notes: tuple[str, ...] = ()
    usual = 0
    if waited.any():
        usual = int(np.median(between[waited]))
    else:
        notes = (_NEVER_WAITED,)
    overhead = np.append(np.where(waited, between, usual), usual)
    return np.maximum(0, ends - starts + overhead), notes


def _wake(file: Path, delays: Times) -> tuple[Times, tuple[str, ...]]:
    """How long the reader took to begin where it was idle, by the clocks of two machines perhaps.

    A message may have been published long before it was sent (a latched one): no delay counts
    for more than the longest that is believed.
    """
    wrong = (delays < 0) | (delays > _LONGEST_WAKE_NS)
    if wrong.mean() > _MOST_WRONG:
        return np.zeros(1, np.int64), (
            (
                f'{file}: the callbacks of an idle reader began {np.median(delays) / _MS:,.1f} ms '
                'after their messages were published (median; negative: before): the clocks of '
                'publisher and reader differ; the reader is taken to begin at once: say --wake, '
                'and set the clocks'
            ),
        )
    return delays.clip(0, _LONGEST_WAKE_NS), ()


def _filled(arrivals: Times, missed: Times) -> Times:
    """The arrivals with those between that never came, evenly."""
    if not missed.any():
        return arrivals
    places = np.cumsum(missed + 1) - 1
    since = np.interp(np.arange(places[-1] + 1), places, arrivals - arrivals[0])
    filled: Times = np.asarray(since, np.int64) + arrivals[0]
    return filled


def _check_one_at_a_time(file: Path, starts: Times, ends: Times) -> None:
    overlaps = int((starts[1:] < ends[:-1]).sum())
    # A clock that is set back a little looks like an overlap, too.
    if overlaps > max(3, len(starts) // 1000):
        text = (
            f'{file}: {overlaps} callbacks began before the one before them had ended: '
            'this model has one at a time (one thread, or a '
            'MutuallyExclusiveCallbackGroup), and one subscription for each file'
        )
        raise ConfigError([text])


def _is_recording(file: Path) -> bool:
    with _told(file, 'text'), file.open(encoding='utf-8') as lines:
        return lines.readline(len(HEADER) + 1).rstrip('\n') == HEADER


def _rows(file: Path) -> Times:
    # The last line is cut short where the program was killed.
    text = _read(file).rpartition('\n')[0]
    with _told(file, 'four numbers a line'):
        rows = np.array([line.split() for line in text.splitlines()[1:]], np.int64)
    if not len(rows):
        raise ConfigError([f'{file}: holds no messages: did one come while it was recorded?'])
    if rows.ndim != 2 or rows.shape[1] != 4:
        raise ConfigError([f'{file}: is not four numbers a line'])
    return rows


def _column(file: Path, what: str) -> Times:
    times = list(_numbers(file, what))
    if not times:
        raise ConfigError([f'{file}: is empty: it needs {what}'])
    with _told(file, what):
        return np.array(times, np.int64)


def _numbers(file: Path, what: str) -> Iterator[int]:
    for number, line in enumerate(_read(file).splitlines(), 1):
        text = line.partition('#')[0].strip()
        if text:
            shown = ascii(text[:_SHOWN_CHARS]) + '...' * (len(text) > _SHOWN_CHARS)
            yield _parsed(text, int, f'{file}:{number}: {shown} is not {what}')


def _parsed(text: str, parse: Callable[[str], int], problem: str) -> int:
    try:
        return parse(text)
    except ValueError as error:
        raise ConfigError([problem]) from error


def _read(file: Path) -> str:
    with _told(file, 'text'), file.open(encoding='utf-8') as content:
        text = content.read(SIZE_LIMIT_BYTES)
        if content.read(1):
            raise ConfigError([f'{file}: larger than {SIZE_LIMIT_BYTES} bytes: use a part of it'])
        return text


@contextmanager
def _told(file: Path, what: str) -> Iterator[None]:
    """Say in a sentence what a file is not."""
    try:
        yield
    except OSError as error:
        raise ConfigError([f'{file}: {error.strerror}']) from error
    except (ValueError, OverflowError) as error:
        raise ConfigError([f'{file}: is not {what}']) from error
