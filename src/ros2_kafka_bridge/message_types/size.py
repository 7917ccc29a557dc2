"""How large a message of a type may be."""

from typing import Final

from ros2_kafka_bridge.message_types.layout import (
    Array,
    Kind,
    Layout,
    Primitive,
    Sequence,
    String,
    is_bulk,
    layouts_in,
    width_of,
)

_HEADER_BYTES: Final = 4
_LENGTH_BYTES: Final = 4
_WCHAR_BYTES: Final = 4
_WIDEST: Final = 8
_PADDED_TO: Final = 4  # by DDS


def largest_message_bytes(layout: Layout, max_message_bytes: int) -> int | None:
    """How large a message may be in CDR; None where only what it holds says so.

    Args:
        layout: Of its type. It says so itself where nothing in it is of any length.
        max_message_bytes: Of the route: as large may those be that hold raw data of any length.
    """
    end = _Ends().end_of(layout, 0)
    size_bytes = None if end is None else _HEADER_BYTES + _aligned(end, _PADDED_TO)
    if size_bytes is not None and (size_bytes <= max_message_bytes or _has_one_size(layout)):
        return size_bytes
    # A bound that is far above all messages says as little as none.
    return max_message_bytes if is_bulk(layout) else None


def _has_one_size(layout: Layout) -> bool:
    kinds = (field.kind for one in layouts_in(layout).values() for field in one.fields)
    return not any(
        isinstance(part, String | Sequence)
        for kind in kinds
        for part in (kind, kind.item if isinstance(kind, Array) else kind)
    )


class _Ends:
    """Tells where a value ends that is as long as it can be; None where that is anywhere."""

    def __init__(self) -> None:
        # By the name and by where it begins: a type that others describe may hold the same one
        # again and again, at each of many levels.
        self._known: dict[tuple[str, int], int | None] = {}

    def end_of(self, kind: Kind, at: int) -> int | None:
        match kind:
            case Primitive():
                return _aligned(at, width_of(kind)) + width_of(kind)
            case String(bound=int(bound), wide=wide):
                size_bytes = bound * _WCHAR_BYTES if wide else bound + 1
                return _aligned(at, _LENGTH_BYTES) + _LENGTH_BYTES + size_bytes
            case Sequence(item=item, bound=int(bound)):
                return self._end_of_all(item, bound, _aligned(at, _LENGTH_BYTES) + _LENGTH_BYTES)
            case Array(item=item, length=length):
                return self._end_of_all(item, length, at)
            case Layout():
                return self._end_of_message(kind, at)
            case String() | Sequence():
                return None  # without a bound

    def _end_of_message(self, layout: Layout, at: int) -> int | None:
        begins = at % _WIDEST
        place = layout.type_name, begins
        if place not in self._known:
            end: int | None = begins if layout.fields else begins + 1
            for field in layout.fields:
                end = None if end is None else self.end_of(field.kind, end)
            self._known[place] = end
        ends = self._known[place]
        return None if ends is None else at - begins + ends

    def _end_of_all(self, item: Kind, count: int, at: int) -> int | None:
        """Where the last of so many ends: from the same alignment on, all is as it was."""
        ends, seen = [at], {at % _WIDEST: 0}
        while len(ends) <= count:
            end = self.end_of(item, ends[-1])
            if end is None:
                return None
            first = seen.setdefault(end % _WIDEST, len(ends))
            if first < len(ends):
                times, rest = divmod(count - first, len(ends) - first)
                return ends[first + rest] + times * (end - ends[first])
            ends.append(end)
        return ends[count]


def _aligned(at: int, width: int) -> int:
    return -(-at // width) * width
