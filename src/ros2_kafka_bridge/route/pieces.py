"""Reading a batch of records in pieces, so that few of them are held with their headers."""

from collections.abc import Callable, Iterator
from typing import Final

from ros2_kafka_bridge.endpoints import Record, RecordSource

PIECE: Final = 50
"""The client unpacks the headers of all that it hands over at once: 7 MB where a record has 99,000
of them, which are a kilobyte on the broker. Looked at they are 24 MB, so each is let go then."""


def in_pieces(
    source: RecordSource, most: int, timeout_s: float, is_full: Callable[[], bool]
) -> Iterator[list[Record]]:
    """Read what is there, in lists of which the last record is the first: to be taken out.

    Args:
        source: Of the records.
        most: How many are read, in whole pieces.
        timeout_s: How long to wait for the first one.
        is_full: Whether none is to be read behind those that were.
    """
    for _ in range(most // PIECE):
        piece = [*reversed(source.poll(PIECE, timeout_s))]
        is_last = len(piece) < PIECE
        yield piece
        if is_last or is_full():
            return
        timeout_s = 0.0
