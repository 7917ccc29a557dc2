"""What a process holds, looked at again and again, and whether it grows."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

_LEAST_POINTS = 3
_ARENA_BYTES: Final = 64 << 20

_Seen = TypeVar('_Seen')


class Vitals(NamedTuple):
    """What a process holds at one moment.

    Args:
        at_s: When, of `time.monotonic`.
        anon_kib: Memory that no other process shares and no file backs.
        descriptors: Open files, sockets and pipes.
    """

    at_s: float
    anon_kib: int
    threads: int
    descriptors: int


def vitals(pid: int) -> Vitals:
    """Look at a process.

    Raises:
        ProcessLookupError: It has ended.
    """
    place = Path('/proc', str(pid))
    try:
        rows = (place / 'status').read_text().splitlines()
        status = dict(row.split(':', 1) for row in rows)
        descriptors = sum(1 for _ in (place / 'fd').iterdir())
        anon_kib = int(status['RssAnon'].split()[0])
    except (FileNotFoundError, KeyError) as error:
        raise ProcessLookupError(f'process {pid} has ended') from error
    return Vitals(time.monotonic(), anon_kib, int(status['Threads']), descriptors)


def held(pid: int) -> Counter[str]:
    """Tell what holds the memory of a process that no file backs, in KiB.

    `heap` is what malloc has of the first thread, `arenas` what it has of the others (glibc
    begins each at a multiple of 64 MiB), `mapped` are Python's objects, large blocks and the
    stacks of threads, `files` what was written to of programs and libraries.

    Raises:
        ProcessLookupError: It has ended.
    """
    found: Counter[str] = Counter()
    kind = ''
    try:
        for line in Path('/proc', str(pid), 'smaps').read_text().splitlines():
            word, *rest = line.split()
            if not word.endswith(':'):
                kind = _kind(int(word.partition('-')[0], 16), rest[4:])
            elif word == 'Anonymous:':
                found[kind] += int(rest[0])
    except FileNotFoundError as error:
        raise ProcessLookupError(f'process {pid} has ended') from error
    return found


def _kind(start: int, name: Sequence[str]) -> str:
    """Which of them a mapping is, by where it begins and its name, if it has one."""
    if not name:
        return 'mapped' if start % _ARENA_BYTES else 'arenas'
    return {'[heap]': 'heap', '[stack]': 'mapped'}.get(name[0], 'files')


@contextmanager
def watched(pid: Callable[[], int], every_s: float = 1.0) -> Iterator[list[Vitals]]:
    """Look at a process again and again, in a thread, as long as it is there."""
    with sampled(lambda: vitals(pid()), every_s) as seen:
        yield seen


@contextmanager
def sampled(look: Callable[[], _Seen], every_s: float) -> Iterator[list[_Seen]]:
    """Look again and again, in a thread, until a process that is looked at has ended."""
    seen = [look()]
    end = threading.Event()

    def go_on() -> None:
        while not end.wait(every_s):
            try:
                seen.append(look())
            except ProcessLookupError:
                return

    thread = threading.Thread(target=go_on, daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        end.set()
        thread.join()


class Slope(NamedTuple):
    """A straight line through points.

    Args:
        per_x: How much y grows while x grows by one.
        error: The standard error of that, as if the points knew nothing of each other.
    """

    per_x: float
    error: float

    @property
    def least(self) -> float:
        """What it grows at least, as far as chance goes: two standard errors less."""
        return self.per_x - 2 * self.error


def slope(points: Sequence[tuple[float, float]]) -> Slope:
    """Fit a straight line by least squares; without three points, it is not known."""
    count = len(points)
    if count < _LEAST_POINTS:
        return Slope(math.nan, math.nan)
    mean_x = sum(x for x, _ in points) / count
    mean_y = sum(y for _, y in points) / count
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    if not spread:
        return Slope(math.nan, math.nan)
    per_x = sum((x - mean_x) * (y - mean_y) for x, y in points) / spread
    left = sum((y - mean_y - per_x * (x - mean_x)) ** 2 for x, y in points)
    return Slope(per_x, math.sqrt(left / (count - 2) / spread))


def means(points: Sequence[tuple[float, float]], width: float) -> list[tuple[float, float]]:
    """Take the mean of all points within each `width` of x: neighbours are much alike."""
    boxes: dict[int, list[tuple[float, float]]] = {}
    for x, y in points:
        boxes.setdefault(int(x / width), []).append((x, y))
    return [
        (sum(x for x, _ in box) / len(box), sum(y for _, y in box) / len(box))
        for _, box in sorted(boxes.items())
    ]
