"""How the commands that look show what they see: tables on a terminal, plain lines elsewhere.

What goes into a pipe or a file is one line for each thing, without colours, never cut short: it
can be searched. What others have written, such as names in the ROS graph, commands no terminal.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Literal, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ros2_kafka_bridge.logs.text import printable, printable_lines
from ros2_kafka_bridge.outside.masking import masked_addresses
from ros2_kafka_bridge.ros.discovery import ANNOUNCED_S

_THING_WIDTH = len('dead letters')  # the longest: the tables stand under each other
_WORD_WIDTH = len('transient_local')  # longer ones are broken where the terminal is narrow

FindingLevel = Literal['ok', 'note', 'bad']
_MARKS: dict[FindingLevel, tuple[str, str]] = {
    'ok': ('ok', 'green'),
    'note': ('note', 'yellow'),
    'bad': ('BAD', 'bold red'),
}


class Finding(NamedTuple):
    """One thing seen, and what it means for the user.

    Args:
        thing: What was looked at, in a word or two.
        text: What would happen.
        cure: What to do about it, where something is to be done.
        waits: What the route would wait for, where it would.
    """

    level: FindingLevel
    thing: str
    text: str
    cure: str = ''
    waits: str = ''


def screen() -> Console:
    """Standard output; nothing in a text is read as markup."""
    return Console(file=sys.stdout, highlight=False, markup=False, emoji=False, soft_wrap=True)


def show_findings(console: Console, title: str, findings: Sequence[Finding]) -> None:
    """Print what was found about one thing: a table on a terminal, a line for each elsewhere."""
    if console.is_terminal:
        console.print(_findings_table(title, findings), '', soft_wrap=False)
        return
    console.print(title)
    for level, _, text, cure, _ in findings:
        told = f'{text}; {cure}' if cure else text
        console.print(f'  {_MARKS[level][0]:4} {_shown(told)}')


def show_notes(console: Console, notes: Sequence[str]) -> None:
    """Print what belongs to the whole, a line each; on a terminal broken between words."""
    word, colour = _MARKS['note']
    for note in notes:
        line = Text.assemble('  ', (word, colour), ' ', _shown(note))
        console.print(line, soft_wrap=not console.is_terminal)


def show_line(console: Console, text: str, style: str = '') -> None:
    """Print a sentence; on a terminal it is broken between words."""
    console.print(
        Text(printable_lines(masked_addresses(text)), style), soft_wrap=not console.is_terminal
    )


def _shown(text: str) -> str:
    return printable(masked_addresses(text))


def _findings_table(title: str, findings: Sequence[Finding]) -> Table:
    table = _table(title, show_header=False)
    table.add_column(no_wrap=True, min_width=4)
    table.add_column(no_wrap=True, min_width=_THING_WIDTH, style='cyan')
    table.add_column(overflow='fold', ratio=1)
    for level, thing, text, cure, _ in findings:
        word, colour = _MARKS[level]
        told = Text.assemble(_shown(text), (f'\n-> {_shown(cure)}', 'bold') if cure else '')
        table.add_row(Text(word, colour), thing, told)
    return table


def show_table(
    console: Console, title: str, columns: Sequence[str], rows: Sequence[Sequence[Sequence[str]]]
) -> None:
    """Print a table whose cells hold lines; a column that begins with `#` holds numbers.

    Elsewhere than on a terminal each row is one line, its cells two blanks apart at least.
    """
    rows = [[[printable(line) for line in cell] for cell in row] for row in rows]
    names = [column.removeprefix('#') for column in columns]
    if console.is_terminal:
        table = _table(title, show_header=True)
        widths = _least_widths(console, names, rows)
        for column, name, width in zip(columns, names, widths, strict=True):
            if column == name:
                table.add_column(name, overflow='fold', min_width=width)
            else:
                table.add_column(name, justify='right', no_wrap=True)
        for row in rows:
            table.add_row(*(Text('\n'.join(cell)) for cell in row))
        console.print(table, '', soft_wrap=False)
        return
    console.print(title)
    for line in _aligned([names, *([_one_line(cell) for cell in row] for row in rows)]):
        console.print(f'  {line}')


def _least_widths(
    console: Console, names: Sequence[str], rows: Sequence[Sequence[Sequence[str]]]
) -> list[int | None]:
    """What keeps the usual words whole, as far as the terminal has room for it."""
    columns = zip(names, *([' '.join(cell) for cell in row] for row in rows), strict=True)
    longest = (max(map(len, ' '.join(column).split())) for column in columns)
    widths = [min(width, _WORD_WIDTH) for width in longest]
    fits = sum(widths) + 3 * len(widths) <= console.width
    return [width if fits else None for width in widths]


def _table(title: str, *, show_header: bool) -> Table:
    return Table(
        title=Text(title, 'bold'),
        title_justify='left',
        show_header=show_header,
        header_style='cyan',
        box=None,
    )


def _one_line(cell: Sequence[str]) -> str:
    return '; '.join(cell) or '-'


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield '  '.join(cells).rstrip()


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Say on a terminal what is waited for; on standard error, which leaves the answer alone."""
    console = Console(file=sys.stderr)
    if console.is_terminal:
        with console.status(what):
            yield
    else:
        yield


def wait_for_discovery() -> None:
    """Give the ROS graph the time in which it shows itself."""
    with waiting(f'Looking at the ROS graph ({ANNOUNCED_S:g} s)'):
        time.sleep(ANNOUNCED_S)
