"""Reading a batch in pieces: what was taken out of one is let go, whatever is behind it."""

import gc
import weakref

from ros2_kafka_bridge.route.pieces import PIECE, in_pieces
from ros2_kafka_bridge.testing.memory import MemoryRecord, MemoryRecordSource


def full(count: int) -> MemoryRecordSource:
    source = MemoryRecordSource()
    source.waiting.extend(MemoryRecord(b'', number) for number in range(count))
    return source


def read(source: MemoryRecordSource, most: int) -> list[int | None]:
    return [
        it.offset()
        for piece in in_pieces(source, most, 0.0, lambda: False)
        for it in reversed(piece)
    ]


def test_it_reads_in_order_and_no_more_than_it_is_asked_for() -> None:
    source = full(7 * PIECE + 1)
    assert read(source, 5 * PIECE) == list(range(5 * PIECE))
    assert read(source, 5 * PIECE) == list(range(5 * PIECE, 7 * PIECE + 1))


def test_no_more_than_a_piece_is_held() -> None:
    source, seen = full(3 * PIECE), []
    for piece in in_pieces(source, 3 * PIECE, 0.0, lambda: False):
        while piece:
            seen.append(weakref.ref(piece.pop()))
        gc.collect(0)
        assert sum(one() is not None for one in seen) == 0
    assert len(seen) == 3 * PIECE


def test_nothing_is_read_behind_what_has_filled_the_window() -> None:
    source = full(7 * PIECE)
    is_full = iter((False, True)).__next__
    assert len([*in_pieces(source, 7 * PIECE, 0.0, is_full)]) == 2
    assert len(source.waiting) == 5 * PIECE
