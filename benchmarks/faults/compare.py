"""How soon streams flow again under the same faults, in several runs side by side, as Markdown.

    python -m benchmarks.faults.compare build/faults/static build/faults/dynamic

Each run is told by its directory, or by the `faults.json` in it. A cell holds one number of
seconds for each time that the fault was injected, in ascending order: how long the stream stood
still, where others take over from what is broken; else from when that was back. `>` says that it
did not flow again as long as it was waited for.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.faults.__main__ import FILE
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.memberships import MEMBERSHIPS
from benchmarks.faults.run import AROUND
from benchmarks.faults.streams import STREAMS

_NONE: Final = '>'


class _Setting(msgspec.Struct):
    membership: str


class _Verdict(msgspec.Struct):
    stream: str
    fault: str
    lost: int
    duplicated: int
    stall_s: float
    recovery_s: float | None


class _Run(msgspec.Struct):
    setting: _Setting
    verdicts: list[_Verdict]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.faults.compare')
    parser.add_argument('runs', nargs='+', type=Path, help=f'directories, or {FILE} in them')
    runs = [_read(place) for place in parser.parse_args(arguments).runs]
    for line in table(runs):
        print(line)
    return 0


def _read(place: Path) -> _Run:
    files = [place] if place.is_file() else sorted(place.rglob(FILE))
    if len(files) != 1:
        raise SystemExit(f'{place} holds {len(files)} files {FILE}, and one run is one of them')
    try:
        return msgspec.json.decode(files[0].read_bytes(), type=_Run)
    except msgspec.ValidationError as error:
        raise SystemExit(f'{files[0]} is no run that has come to its end: {error}') from error


def table(runs: Sequence[_Run]) -> Iterator[str]:
    """The lines of a table: a row for each stream and fault, a column for each run."""
    yield _row('', [MEMBERSHIPS[run.setting.membership].words for run in runs])
    yield f'|---|{"---|" * len(runs)}'
    kinds = {(v.stream, v.fault) for run in runs for v in run.verdicts if v.fault != AROUND}
    for stream, fault in sorted(kinds, key=_place):
        words = f'{STREAMS[stream].words}: {FAULTS[fault].words}'
        yield _row(words, [_times(run, stream, fault) for run in runs])
    for stream in sorted({stream for stream, _ in kinds}, key=list(STREAMS).index):
        ends = [[v for v in run.verdicts if v.stream == stream] for run in runs]
        counts = [f'{sum(v.lost for v in of)}, {sum(v.duplicated for v in of)}' for of in ends]
        yield _row(f'{STREAMS[stream].words}: lost, repeated', counts)


def _row(head: str, cells: Sequence[str]) -> str:
    return f'| {" | ".join([head, *cells])} |'


def _place(kind: tuple[str, str]) -> tuple[int, int]:
    return list(STREAMS).index(kind[0]), list(FAULTS).index(kind[1])


def _times(run: _Run, stream: str, fault: str) -> str:
    found = [v for v in run.verdicts if (v.stream, v.fault) == (stream, fault)]
    times_s = [v.stall_s if FAULTS[fault].by_another else v.recovery_s for v in found]
    known = sorted(time_s for time_s in times_s if time_s is not None)
    return ' '.join([f'{time_s:.1f}' for time_s in known] + [_NONE] * times_s.count(None))


if __name__ == '__main__':
    sys.exit(main())
