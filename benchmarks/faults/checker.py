"""Whether every order arrived, in order, and once: numbers in, numbers out, nothing else.

A run is cut into windows, one for each fault: from the moment when all was well before it to the
moment when all was well again. An order that is lost belongs to the window in which it was sent,
one that came twice or too late to the window in which it came. What a fault may cost is an
`Allowance`; everything beyond it is a breach of a guarantee.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from ros2_kafka_bridge.dedup import Deduplicator


class Seen(NamedTuple):
    """An order, and when it was sent or came, in nanoseconds since 1970."""

    number: int
    time_ns: int


class Ends(NamedTuple):
    """What the two ends of a stream tell.

    Args:
        sent: Good orders, in the order of sending.
        hostile: Those that were no good orders.
        uncounted: Numbers that nobody has promised anything about: their sender was killed before
            they had been taken from it. They may arrive or not.
        arrived: All that came, in the order of coming, repeats too.
        dead_lettered: Found in the dead-letter topic, repeats too.
        lines: Orders n, n + lines, n + 2 * lines ... are in order among themselves.
    """

    sent: Sequence[Seen]
    hostile: Sequence[Seen]
    uncounted: Collection[int]
    arrived: Sequence[Seen]
    dead_lettered: Sequence[Seen]
    lines: int = 1


class Found(NamedTuple):
    """What is wrong with a stream, allowed or not.

    Args:
        lost: Sent, and neither arrived nor dead-lettered; time of sending.
        duplicated: Each repeat; time of its coming. A dead letter may be written twice.
        out_of_order: Came first when a later one of its line had come; time of its coming.
        refused: Good orders in the dead-letter topic; time there.
        invented: Came and were never sent; time of their coming.
    """

    lost: Sequence[Seen]
    duplicated: Sequence[Seen]
    out_of_order: Sequence[Seen]
    refused: Sequence[Seen]
    invented: Sequence[Seen]


class Window(NamedTuple):
    """One fault, in nanoseconds since 1970.

    Args:
        fault: Its name.
        start_ns: When it was injected.
        back_ns: When what was broken was back; None where nothing was broken.
        end_ns: When all was well again.
        hold_s: How long it lasted.
        target: Name of the one stream that it was aimed at; empty where at all.
        late: Names of streams that did not flow again.
        away_ns: From when to when nobody took from ROS publishers; None where that is the time
            from the fault until a stream flows again.
        by_another: Whether another takes over from what is broken. What was on its way when it
            broke may come still, hence the time to recover is that of the longest stall.
    """

    fault: str
    start_ns: int
    back_ns: int | None
    end_ns: int
    hold_s: float = 0.0
    target: str = ''
    late: Sequence[str] = ()
    away_ns: tuple[int, int] | None = None
    by_another: bool = False


class Allowance(NamedTuple):
    """What the guarantees let a fault cost a stream.

    Args:
        duplicated: Whether orders may come twice.
        lost: So many orders may be lost: what memory held that died.
        lost_while_away: And those sent from the fault until the stream flows again, or, where
            the window tells, while nobody took them.
        is_held_back: Its publisher is held back by the fault, and what waits there is lost, too.
        out_of_order: So many orders may come first behind a later one.
        why: The reason of a loss or disorder, in a few words.
    """

    duplicated: bool = False
    lost: int = 0
    lost_while_away: bool = False
    is_held_back: bool = False
    out_of_order: int = 0
    why: str = ''


class Verdict(NamedTuple):
    """A stream in a window.

    Args:
        sent: Orders sent in it.
        bound: So many may have been lost.
        stall_s: Longest time without a new order, from the fault on.
        recovery_s: From the return of what was broken to the next new order; None where nothing
            was broken, or no order came any more.
        wrong: What the guarantees do not allow, in words.
    """

    stream: str
    fault: str
    sent: int
    lost: int
    bound: int
    duplicated: int
    out_of_order: int
    stall_s: float
    recovery_s: float | None
    wrong: Sequence[str]


def compare(ends: Ends) -> Found:
    """Compare what was sent with what came."""
    known = {seen.number for seen in ends.sent} | {seen.number for seen in ends.hostile}
    good = {seen.number for seen in ends.sent}
    there = {seen.number for seen in (*ends.arrived, *ends.dead_lettered)}
    to_come = [seen for seen in (*ends.sent, *ends.hostile) if seen.number not in there]
    return Found(
        lost=sorted(seen for seen in to_come if seen.number not in set(ends.uncounted)),
        duplicated=_repeats(ends.arrived),
        out_of_order=_late(ends.arrived, ends.lines),
        refused=[seen for seen in ends.dead_lettered if seen.number in good],
        invented=[seen for seen in ends.arrived if seen.number not in known],
    )


def firsts(arrived: Iterable[Seen]) -> list[Seen]:
    """What came, without repeats."""
    known: set[int] = set()
    found = []
    for seen in arrived:
        if seen.number not in known:
            known.add(seen.number)
            found.append(seen)
    return found


def _repeats(arrived: Iterable[Seen]) -> list[Seen]:
    known: set[int] = set()
    found = []
    for seen in arrived:
        if seen.number in known:
            found.append(seen)
        known.add(seen.number)
    return found


def _late(arrived: Iterable[Seen], lines: int) -> list[Seen]:
    highest = [-1] * lines
    found = []
    for seen in firsts(arrived):
        line = seen.number % lines
        if seen.number < highest[line]:
            found.append(seen)
        highest[line] = max(highest[line], seen.number)
    return found


def judge(
    stream: str,
    ends: Ends,
    found: Found,
    window: Window,
    since_ns: int,
    allowance: Allowance,
) -> Verdict:
    """Hold what happened to a stream in a window against what is allowed.

    Args:
        stream: Its name.
        ends: What its two ends tell.
        found: What is wrong with it, in the whole run.
        window: The one to look at.
        since_ns: The end of the window before this one.
        allowance: What the fault of the window may cost it.
    """

    def within(many: Iterable[Seen]) -> list[Seen]:
        return [seen for seen in many if since_ns < seen.time_ns <= window.end_ns]

    lines = _times_by_line(ends)
    gap = max(longest_gap(times_ns, window.start_ns, window.end_ns) for times_ns in lines)
    flows_ns = _flows_ns(lines, window, gap)
    bound = allowance.lost
    if allowance.lost_while_away:
        from_ns, until_ns = window.start_ns, window.end_ns if flows_ns is None else flows_ns
        if window.away_ns is not None and not allowance.is_held_back:
            from_ns, until_ns = window.away_ns
        bound += sum(from_ns <= seen.time_ns <= until_ns for seen in ends.sent)
    lost, duplicated = len(within(found.lost)), len(within(found.duplicated))
    late = len(within(found.out_of_order))
    wrong = {
        f'lost {lost}, allowed {bound}': lost > bound,
        f'duplicated {duplicated}, allowed none': duplicated > 0 and not allowance.duplicated,
        f'out of order {late}, allowed {allowance.out_of_order}': late > allowance.out_of_order,
        'good orders dead-lettered': bool(within(found.refused)),
        'orders that nobody sent': bool(within(found.invented)),
        'does not flow again': stream in window.late,
    }
    recovery_s = None
    if window.target in {'', stream} and window.back_ns is not None and flows_ns is not None:
        from_ns = gap.start_ns if window.by_another else window.back_ns
        recovery_s = (flows_ns - from_ns) / 1e9
    return Verdict(
        stream,
        window.fault,
        len(within(ends.sent)) + len(within(ends.hostile)),
        lost,
        bound,
        duplicated,
        late,
        gap.length_ns / 1e9,
        recovery_s,
        [words for words, is_wrong in wrong.items() if is_wrong],
    )


class Gap(NamedTuple):
    """A time without a new order, in nanoseconds; the start since 1970."""

    length_ns: int
    start_ns: int


def longest_gap(times_ns: Sequence[int], start_ns: int, end_ns: int) -> Gap:
    """Longest time between two orders, or one and the start or the end."""
    inside = times_ns[bisect_left(times_ns, start_ns) : bisect_right(times_ns, end_ns)]
    return max(Gap(after - at, at) for at, after in pairwise([start_ns, *inside, end_ns]))


def _times_by_line(ends: Ends) -> list[list[int]]:
    """When new orders came, in each line: while one of them stalls, the others may flow."""
    lines: list[list[int]] = [[] for _ in range(ends.lines)]
    for seen in firsts(ends.arrived):
        lines[seen.number % ends.lines].append(seen.time_ns)
    return lines


def _flows_ns(lines: Sequence[Sequence[int]], window: Window, gap: Gap) -> int | None:
    """When every line flows again; None where one does not."""
    if window.by_another:
        end_ns = gap.start_ns + gap.length_ns
        return end_ns if end_ns < window.end_ns else None
    found = [_next(times_ns, window.back_ns or window.start_ns) for times_ns in lines]
    return None if None in found else max(time_ns for time_ns in found if time_ns is not None)


def _next(times_ns: Sequence[int], from_ns: int) -> int | None:
    place = bisect_left(times_ns, from_ns)
    return times_ns[place] if place < len(times_ns) else None


class Spread(NamedTuple):
    """How some times lie, in seconds.

    Args:
        p95_s: 95 of 100 are no longer.
    """

    least_s: float
    median_s: float
    p95_s: float
    most_s: float


def spread(times_s: Sequence[float]) -> Spread:
    """Tell how some times lie."""
    found = sorted(times_s)
    return Spread(found[0], median(found), found[-(-95 * len(found) // 100) - 1], found[-1])


class Row(NamedTuple):
    """All that happened to a stream by one kind of fault.

    Args:
        times: How often it was injected.
        bound: Of the losses, summed up.
        bound_why: The reason of the bound.
        recovery_s: The longest; None where there is none.
        recoveries: How all of them lie; None where there is none.
        in_time: Whether it was within what is required; None where nothing is.
    """

    stream: str
    fault: str
    times: int
    sent: int
    lost: int
    bound: int
    bound_why: str
    duplicated: int
    out_of_order: int
    stall_s: float
    recovery_s: float | None
    recoveries: Spread | None
    in_time: bool | None
    wrong: Sequence[str]


def summed(verdicts: Sequence[Verdict], required_s: float | None, why: str) -> Row:
    """Sum up the verdicts of one stream and one kind of fault."""
    recoveries = [verdict.recovery_s for verdict in verdicts if verdict.recovery_s is not None]
    in_time = None
    if required_s is not None:
        in_time = len(recoveries) == len(verdicts) and max(recoveries, default=0) <= required_s
    return Row(
        verdicts[0].stream,
        verdicts[0].fault,
        len(verdicts),
        sum(verdict.sent for verdict in verdicts),
        sum(verdict.lost for verdict in verdicts),
        sum(verdict.bound for verdict in verdicts),
        why,
        sum(verdict.duplicated for verdict in verdicts),
        sum(verdict.out_of_order for verdict in verdicts),
        max(verdict.stall_s for verdict in verdicts),
        max(recoveries, default=None),
        spread(recoveries) if recoveries else None,
        in_time,
        [words for verdict in verdicts for words in verdict.wrong],
    )


def by_stream_and_fault(
    verdicts: Iterable[Verdict],
) -> Mapping[tuple[str, str], Sequence[Verdict]]:
    """Sort verdicts, in the order of their first coming."""
    found: dict[tuple[str, str], list[Verdict]] = {}
    for verdict in verdicts:
        found.setdefault((verdict.stream, verdict.fault), []).append(verdict)
    return found


def not_removable(records: Iterable[tuple[int, tuple[str, int] | None]]) -> list[int]:
    """Repeated orders that a reader who leaves out repeats by (gid, seq) still gets twice.

    Args:
        records: Number of an order; its publisher and number there, None where that is not told.
    """
    reader = Deduplicator()
    known: set[int] = set()
    found = []
    for number, place in records:
        if place is None or reader.is_new_number(bytes.fromhex(place[0]), place[1]):
            if number in known:
                found.append(number)
            known.add(number)
    return found
