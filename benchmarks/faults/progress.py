"""How far the streams of a run have come."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.faults import journal
from benchmarks.faults.journal import Entry, Tail
from benchmarks.faults.streams import Stream


class Progress:
    """How far a stream has come, by the journals of its two ends."""

    def __init__(self, stream: Stream, sent: Path, arrived: Path) -> None:
        self.stream = stream
        self.sent_file = sent
        self.arrived_file = arrived
        self._tails = Tail(sent), Tail(arrived)
        self._sent = [-1] * stream.lines
        self._arrived = [-1] * stream.lines
        self.last_sent = -1
        self.count = 0

    def look(self) -> None:
        """Read what has been added."""
        sent, arrived = (tail() for tail in self._tails)
        for entry in sent:
            # One that is no good order may go elsewhere.
            if entry.mark == journal.SENT:
                self._note(self._sent, entry)
            if entry.mark in {journal.SENT, journal.HOSTILE}:
                self.last_sent = max(self.last_sent, entry.number)
        for entry in arrived:
            if entry.mark == journal.ARRIVED:
                self._note(self._arrived, entry)
                self.count += 1

    def marks(self) -> list[int]:
        """The last good order that was sent, of each line."""
        return list(self._sent)

    def has_reached(self, marks: Sequence[int]) -> bool:
        """Whether these orders, or later ones, have come."""
        return all(here >= mark for here, mark in zip(self._arrived, marks, strict=True))

    def _note(self, highest: list[int], entry: Entry) -> None:
        line = entry.number % self.stream.lines
        highest[line] = max(highest[line], entry.number)
