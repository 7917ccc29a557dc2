"""What a run has found, for people and for programs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from rich.console import Console
from rich.table import Table

from benchmarks.faults.checker import Row, Spread
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.plan import Step
from benchmarks.faults.run import AROUND, Outcome
from benchmarks.faults.streams import STREAMS
from benchmarks.machine import machine, versions

_HEADS: Final = (
    'times', 'orders', 'lost', 'bound', 'duplicated', 'out of order', 'longest stall',
    'time to recover',
)  # fmt: skip


def show(console: Console, outcome: Outcome) -> None:
    """Print the tables, one for each stream."""
    for name in dict.fromkeys(row.stream for row in outcome.rows):
        rows = [row for row in outcome.rows if row.stream == name]
        console.print(_table(STREAMS[name].words, rows))
        for row in rows:
            if row.recoveries is not None:
                words = f'{row.fault}, flows again: {_spread(row.recoveries)}'
                console.print(f'    {words}', style='dim', highlight=False)
        for words in dict.fromkeys(
            f'bound of {row.fault}: {row.bound_why}' for row in rows if row.bound_why
        ):
            console.print(f'    {words}', style='dim', highlight=False)
    for row in outcome.rows:
        for words in row.wrong:
            console.print(f'WRONG: {row.stream}, {row.fault}: {words}', style='bold red')
    for words in outcome.breaches:
        console.print(f'WRONG: {words}', style='bold red')


def _table(title: str, rows: Sequence[Row]) -> Table:
    table = Table(title=title, title_justify='left')
    table.add_column('fault', no_wrap=True)
    for head in _HEADS:
        table.add_column(head, justify='right')
    table.add_column('')
    for row in rows:
        table.add_row(
            row.fault if row.fault != AROUND else '(none)',
            str(row.times) if row.fault != AROUND else '',
            str(row.sent),
            str(row.lost),
            f'{row.bound}' if row.bound else '',
            str(row.duplicated),
            str(row.out_of_order),
            f'{row.stall_s:.2f} s' if row.fault != AROUND else '',
            _recovery(row),
            _mark(row),
        )
    return table


def _mark(row: Row) -> str:
    if row.wrong:
        return '[bold red]FAIL'
    return '[red]FAIL (time)' if row.in_time is False else 'PASS'


def _recovery(row: Row) -> str:
    if row.recovery_s is None:
        return ''
    required_s = FAULTS[row.fault].limit_s(STREAMS[row.stream])
    limit = '' if required_s is None else f' (≤ {required_s:.0f} s)'
    return f'{row.recovery_s:.2f} s{limit}'


def _spread(times: Spread) -> str:
    return (
        f'{times.least_s:.2f} s at least, {times.median_s:.2f} s in the median, '
        f'{times.p95_s:.2f} s in 95 of 100, {times.most_s:.2f} s at most'
    )


def keep(
    file: Path, setting: Mapping[str, Any], plan: Sequence[Step], outcome: Outcome | None
) -> None:
    """Write the plan and, once there is one, the outcome."""
    content: dict[str, Any] = {
        'setting': setting,
        'machine': machine()._asdict(),
        'versions': versions(is_local_kafka=True),
        'plan': msgspec.to_builtins(plan),
    }
    if outcome is not None:
        content |= {
            'is_good': outcome.is_good,
            'breaches': list(outcome.breaches),
            'rows': [_plain(row) for row in outcome.rows],
            'windows': [window._asdict() for window in outcome.windows],
            'verdicts': [verdict._asdict() for verdict in outcome.verdicts],
        }
    file.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')


def _plain(row: Row) -> dict[str, Any]:
    recoveries = row.recoveries
    return row._asdict() | {'recoveries': recoveries and recoveries._asdict()}
