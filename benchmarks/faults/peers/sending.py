"""What senders of numbered orders have in common: what they are told, their pace, their journal.

They are told by a file that lines are added to: `hostile N` makes the next N orders hostile ones,
`clock SECONDS` puts a clock forward or back for the times of records, `enough` ends the sending
and keeps the sender: a TRANSIENT_LOCAL history lives as long as its node.
"""

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NoReturn, Protocol

from benchmarks.faults import orders
from benchmarks.faults.journal import ACKNOWLEDGED, BEGUN, HOSTILE, SENT, Journal

_LATEST_S: Final = 0.2


class End(Protocol):
    """Where orders are sent to."""

    @property
    def hostile(self) -> Sequence[orders.Hostile]:
        """The kinds of hostile orders that can be sent there."""

    def send(self, number: int, kind: orders.Hostile, clock_s: int) -> None:
        """Hand over an order; waits while there is no room."""

    def has_all(self) -> bool:
        """Whether all is acknowledged: that can no longer die with this process."""


class Commands:
    """The commands that are added to a file from now on."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._place = file.stat().st_size if file.exists() else 0

    def __call__(self) -> list[list[str]]:
        """Those that have come since, as words."""
        if not self._file.exists() or self._file.stat().st_size == self._place:
            return []
        with self._file.open('rb') as file:
            file.seek(self._place)
            data = file.read()
        whole = data[: data.rfind(b'\n') + 1]
        self._place += len(whole)
        return [line.split() for line in whole.decode().splitlines()]


def parser_of_sender() -> argparse.ArgumentParser:
    """Make a parser with the options of every sender."""
    parser = argparse.ArgumentParser()
    parser.add_argument('topic')
    parser.add_argument('journal', type=Path)
    parser.add_argument('commands', type=Path)
    parser.add_argument('--rate', type=float, required=True)
    parser.add_argument('--first', type=int, default=0, help='number of the first order')
    parser.add_argument('--seed', type=int, default=1)
    return parser


def send(end: End, commands: Commands, options: Any) -> NoReturn:
    """Send until this process is ended.

    An order is written down before it is handed over, so that none is sent that is not known.
    Who was held back goes on at the same rate.
    """
    journal = Journal(options.journal)
    journal.write(BEGUN, os.getpid())
    make = orders.numbered(options.seed)
    kinds = orders.in_turn(end.hostile)
    number, acknowledged, hostile, clock_s = options.first, options.first - 1, 0, 0
    enough = False
    due_s = time.monotonic()
    while True:
        time.sleep(max(0.0, due_s - time.monotonic()))
        due_s = max(due_s + 1 / options.rate, time.monotonic() - _LATEST_S)
        for words in commands():
            hostile += int(words[1]) if words[0] == 'hostile' else 0
            clock_s = int(words[1]) if words[0] == 'clock' else clock_s
            enough = enough or words[0] == 'enough'
        if acknowledged < number - 1 and end.has_all():
            acknowledged = number - 1
            journal.write(ACKNOWLEDGED, acknowledged)
        if not enough:
            kind = next(kinds) if hostile else orders.Hostile('', make)
            journal.write(HOSTILE if hostile else SENT, number)
            end.send(number, kind, clock_s)
            number += 1
            hostile = max(0, hostile - 1)
