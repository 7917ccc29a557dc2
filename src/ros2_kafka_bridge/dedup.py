"""Telling new records from repeated ones, for programs that read what the bridge has written.

Every record from ROS says in its headers which publisher its message is from (`ros.gid`) and
which number it has there (`ros.seq`). A bridge that takes over from another, or starts again
after a crash, may write some of them once more: with these two a reader leaves them out.

    for record in without_repeats(records):
        ...

These headers are believed: see `Deduplicator`. Needs no Kafka client: a record is anything with
the `headers()` of confluent_kafka's Message.
"""

import json
import re
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, Final, TypeVar

from ros2_kafka_bridge.endpoints import HasHeaders, HeaderList, headers_of

MAX_PUBLISHERS: Final = 1000
MAX_GAPS: Final = 1000
_VERSION: Final = 1
_GID: Final = re.compile(r'[0-9a-f]{32}')
_SEQ: Final = re.compile(r'\d{1,19}', re.ASCII)
_LONGEST: Final = 32

AnyRecord = TypeVar('AnyRecord', bound=HasHeaders)
Known = TypeVar('Known')


class Numbers:
    """A set of whole numbers, kept as its runs: what has no gap takes no memory.

    Args:
        max_gaps: How many gaps are kept. The oldest run is forgotten for more: its numbers are
            no longer in the set.
    """

    __slots__ = ('_ends', '_max_gaps', '_starts')

    def __init__(self, max_gaps: int = MAX_GAPS) -> None:
        self._max_gaps = max_gaps
        self._starts: list[int] = []  # of the runs, ascending
        self._ends: list[int] = []  # the number behind each run

    def add(self, number: int) -> bool:
        """Add a number; False where it was there already."""
        starts, ends = self._starts, self._ends
        if ends and number == ends[-1]:
            ends[-1] += 1
            return True
        place = bisect_right(starts, number)
        if place and number < ends[place - 1]:
            return False
        self._insert(place, number)
        return True

    def _insert(self, place: int, number: int) -> None:
        """Add a number that is not there, behind the first `place` runs."""
        starts, ends = self._starts, self._ends
        joins_left = place > 0 and ends[place - 1] == number
        joins_right = place < len(starts) and starts[place] == number + 1
        if joins_left and joins_right:
            ends[place - 1] = ends[place]
            del starts[place], ends[place]
        elif joins_left:
            ends[place - 1] += 1
        elif joins_right:
            starts[place] -= 1
        else:
            starts.insert(place, number)
            ends.insert(place, number + 1)
            if len(starts) > self._max_gaps + 1:
                del starts[0], ends[0]

    def append(self, run: range) -> None:
        """Add numbers that lie behind all that are there.

        Raises:
            ValueError: They do not, or there are none.
        """
        if not run or (self._ends and run.start <= self._ends[-1]):
            raise ValueError('the runs are not ascending')
        self._starts.append(run.start)
        self._ends.append(run.stop)
        if len(self._starts) > self._max_gaps + 1:
            del self._starts[0], self._ends[0]

    def __contains__(self, number: int) -> bool:
        place = bisect_right(self._starts, number)
        return place > 0 and number < self._ends[place - 1]

    @property
    def first(self) -> int:
        """The lowest; 0 where there is none."""
        return self._starts[0] if self._starts else 0

    def runs(self) -> list[range]:
        """The numbers without a gap between them, ascending."""
        return [range(start, end) for start, end in zip(self._starts, self._ends, strict=True)]

    def gaps(self) -> list[range]:
        """The numbers missing between the lowest and the highest."""
        return [range(e, s) for e, s in zip(self._ends, self._starts[1:], strict=False)]


class Deduplicator:
    """Remembers publisher and number of each record, and tells the repeated ones.

    It is exact: a number is new once, also one that comes late and fills a gap. What it forgets
    at its limits counts as new again, so that no limit leaves a message out. Not to be used
    from several threads at a time.

    It believes `ros.gid` and `ros.seq`. Whoever else may write to the topic can write a number
    that is still to come, and the record of the bridge with that number is left out then; a
    program that copies headers to another topic makes copies that are left out there. So the
    bridge alone should have WRITE on the topic that is read (docs/security.md), or the record has
    to carry an id of its own to be told apart by.

    Args:
        max_publishers: How many publishers are remembered; the one heard least recently is
            forgotten for a further one.
        max_gaps: How many gaps are remembered of each; what lies before them is forgotten.
    """

    def __init__(self, max_publishers: int = MAX_PUBLISHERS, max_gaps: int = MAX_GAPS) -> None:
        self._max_publishers = max_publishers
        self._max_gaps = max_gaps
        self._seen: OrderedDict[bytes, Numbers] = OrderedDict()  # heard least recently first

    def is_new(self, record: HasHeaders) -> bool:
        """Whether a record is seen for the first time; one without the headers always is."""
        place = place_of(record)
        return place is None or self.is_new_number(*place)

    def is_new_number(self, gid: bytes, seq: int) -> bool:
        """Whether message `seq` of the publisher `gid` is seen for the first time."""
        make = partial(Numbers, self._max_gaps)
        return of_publisher(self._seen, gid, make, self._max_publishers).add(seq)

    def without_repeats(self, records: Iterable[AnyRecord]) -> Iterator[AnyRecord]:
        """Leave out the records that were seen before."""
        return (record for record in records if self.is_new(record))

    def gaps(self) -> dict[bytes, list[range]]:
        """The numbers that are missing so far, by publisher: between its first and its last."""
        found = {gid: numbers.gaps() for gid, numbers in self._seen.items()}
        return {gid: gaps for gid, gaps in found.items() if gaps}

    def to_json(self) -> str:
        """Write what is remembered, to be kept by whoever reads on after a restart."""
        publishers = [
            {'gid': gid.hex(), 'seen': [[run.start, run.stop - 1] for run in numbers.runs()]}
            for gid, numbers in self._seen.items()
        ]
        return json.dumps({'version': _VERSION, 'publishers': publishers})

    @classmethod
    def from_json(
        cls, text: str, max_publishers: int = MAX_PUBLISHERS, max_gaps: int = MAX_GAPS
    ) -> 'Deduplicator':
        """Read what `to_json` has written.

        Raises:
            ValueError: It is something else.
        """
        made = cls(max_publishers, max_gaps)
        try:
            for publisher in _publishers(json.loads(text))[-max_publishers:]:
                numbers = made._seen[bytes.fromhex(publisher['gid'])] = Numbers(max_gaps)
                for first, last in publisher['seen']:
                    numbers.append(range(int(first), int(last) + 1))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f'not the state of a Deduplicator: {error}') from error
        return made


def without_repeats(records: Iterable[AnyRecord]) -> Iterator[AnyRecord]:
    """Leave out the records that came before: a `Deduplicator` with its usual limits."""
    return Deduplicator().without_repeats(records)


def of_publisher(
    known: OrderedDict[bytes, Known], gid: bytes, make: Callable[[], Known], most: int
) -> Known:
    """What is known of a publisher, made now where it is heard for the first time.

    Args:
        known: By publisher, the one heard least recently first.
        gid: Of the publisher.
        make: Makes what is known of one that is new.
        most: How many are remembered: for one more the first is forgotten.
    """
    found = known.get(gid)
    if found is None:
        found = known[gid] = make()
        if len(known) > most:
            known.popitem(last=False)
    else:
        known.move_to_end(gid)
    return found


def place_of(record: HasHeaders) -> tuple[bytes, int] | None:
    """Publisher and number of a record; None where its headers do not tell."""
    return place_in(headers_of(record) or [])


def place_in(headers: HeaderList) -> tuple[bytes, int] | None:
    """Publisher and number, of the headers of a record; None where they do not tell.

    Anyone may write such headers: what does not look like the bridge's says nothing, and nothing
    is made of it, however long it is.
    """
    told = dict(headers)
    gid, seq = _text(told.get('ros.gid')), _text(told.get('ros.seq'))
    if not _GID.fullmatch(gid) or not _SEQ.fullmatch(seq):
        return None
    return bytes.fromhex(gid), int(seq)


def _text(value: str | bytes | None) -> str:
    """A header that is short enough to be of the bridge; empty for any other."""
    if value is None or len(value) > _LONGEST:
        return ''
    return value if isinstance(value, str) else value.decode('ascii', 'replace')


def _publishers(state: Any) -> list[Any]:
    if state['version'] != _VERSION:
        raise ValueError(f'version {state["version"]} is not known here')
    return list(state['publishers'])
