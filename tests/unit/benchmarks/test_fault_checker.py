"""The fault bench's checker: what it finds in numbers, and what it holds against a bound."""

import random
from datetime import datetime
from pathlib import Path

import pytest

from benchmarks.faults import said
from benchmarks.faults.checker import (
    Allowance,
    Ends,
    Found,
    Seen,
    Spread,
    Verdict,
    Window,
    compare,
    firsts,
    judge,
    longest_gap,
    not_removable,
    spread,
    summed,
)
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.journal import Entry, Journal, Tail, read, uncounted
from benchmarks.faults.plan import make_plan
from benchmarks.faults.streams import FROM_KAFKA, LATCHED, SPOOLED_ALWAYS, VOLATILE

SECOND = 1_000_000_000


def at(*numbers: int, from_s: float = 0.0) -> list[Seen]:
    """These orders, one a second."""
    start = int(from_s * SECOND)
    return [Seen(number, start + place * SECOND) for place, number in enumerate(numbers)]


def ends(
    sent: list[Seen],
    arrived: list[Seen],
    *,
    hostile: list[Seen] | None = None,
    letters: list[Seen] | None = None,
    uncounted: set[int] | None = None,
    lines: int = 1,
) -> Ends:
    return Ends(sent, hostile or [], uncounted or set(), arrived, letters or [], lines)


def numbers(seen: object) -> list[int]:
    assert isinstance(seen, list)
    return [one.number for one in seen]


def found_in(found: Found) -> dict[str, list[int]]:
    return {name: numbers(list(seen)) for name, seen in found._asdict().items() if seen}


# compare


def test_all_that_came_once_and_in_order_is_well() -> None:
    assert found_in(compare(ends(at(0, 1, 2), at(0, 1, 2)))) == {}


def test_what_never_came_is_lost() -> None:
    assert found_in(compare(ends(at(0, 1, 2, 3), at(0, 3)))) == {'lost': [1, 2]}


def test_each_repeat_is_a_duplicate_and_out_of_order_counts_only_what_comes_first() -> None:
    found = compare(ends(at(0, 1, 2, 3), at(0, 1, 2, 1, 2, 2, 3)))
    assert found_in(found) == {'duplicated': [1, 2, 2]}


def test_what_comes_first_behind_a_later_one_is_out_of_order() -> None:
    found = compare(ends(at(0, 1, 2, 3), at(0, 2, 1, 3)))
    assert found_in(found) == {'out_of_order': [1]}


def test_order_is_promised_within_a_line_only() -> None:
    arrived = at(0, 3, 6, 1, 4, 2, 5)
    assert found_in(compare(ends(at(*range(7)), arrived, lines=3))) == {}
    found = compare(ends(at(*range(7)), at(3, 0, 6, 1, 4, 2, 5), lines=3))
    assert found_in(found) == {'out_of_order': [0]}


def test_a_hostile_record_is_delivered_or_dead_lettered_and_not_lost_without_a_trace() -> None:
    hostile = at(1, 2, 3)
    found = compare(ends(at(0, 4), at(0, 1, 4), hostile=hostile, letters=at(2, 2)))
    assert found_in(found) == {'lost': [3]}, 'a dead letter may be written twice'


def test_a_good_order_has_no_business_among_the_dead_letters() -> None:
    assert found_in(compare(ends(at(0, 1), at(0), letters=at(1)))) == {'refused': [1]}


def test_an_order_that_nobody_sent_is_found() -> None:
    assert found_in(compare(ends(at(0), at(0, 7)))) == {'invented': [7]}


def test_what_died_with_its_publisher_may_come_or_not() -> None:
    assert found_in(compare(ends(at(0, 1, 2, 3), at(0, 2, 3), uncounted={1, 2}))) == {}


@pytest.mark.parametrize('seed', range(20))
def test_whatever_is_done_to_a_stream_is_found_again(seed: int) -> None:
    draw = random.Random(seed)  # noqa: S311 - chance, no secret
    sent = at(*range(300))
    lost = set(draw.sample(range(300), 12))
    left = [seen.number for seen in sent if seen.number not in lost]
    repeated = sorted(draw.sample(left, 9))
    # A repeat somewhere behind its first coming.
    arrived = list(left)
    for number in repeated:
        arrived.insert(draw.randrange(arrived.index(number) + 1, len(arrived) + 1), number)
    found = compare(ends(sent, at(*arrived)))
    assert set(numbers(list(found.lost))) == lost
    assert sorted(numbers(list(found.duplicated))) == repeated
    assert found.out_of_order == []


# judge

SENT = at(*range(30))


def verdict(
    arrived: list[Seen],
    window: Window,
    allowance: Allowance = Allowance(),  # noqa: B008 - it cannot be changed
    since_s: float = 0.0,
) -> Verdict:
    here = ends(SENT, arrived)
    return judge('s', here, compare(here), window, int(since_s * SECOND), allowance)


def window(start_s: float, back_s: float | None, end_s: float) -> Window:
    back_ns = None if back_s is None else int(back_s * SECOND)
    return Window('kill', int(start_s * SECOND), back_ns, int(end_s * SECOND))


def without(*gone: int) -> list[Seen]:
    return [seen for seen in SENT if seen.number not in gone]


def test_a_loss_belongs_to_the_window_in_which_the_order_was_sent() -> None:
    arrived = without(12)
    assert verdict(arrived, window(10, None, 15)).wrong == ['lost 1, allowed 0']
    after = verdict(arrived, window(16, None, 29), since_s=15.0)
    assert (after.lost, after.wrong) == (0, [])


def test_a_bound_is_what_memory_held_and_what_was_sent_until_the_stream_flows_again() -> None:
    allowance = Allowance(lost=2, lost_while_away=True)
    # Broken at 10, back at 13, and the first order comes at 15: 10 to 15 were sent meanwhile.
    held = verdict(without(8, 9, *range(10, 15)), window(10, 13, 20), allowance)
    assert (held.lost, held.bound, held.wrong) == (7, 2 + 6, [])
    assert held.recovery_s == 2.0
    assert held.stall_s == 5.0
    broken = verdict(without(8, 9, *range(10, 15), 17, 18), window(10, 13, 20), allowance)
    assert broken.wrong == ['lost 9, allowed 8']


def test_repeats_count_where_they_come_and_only_some_faults_may_cause_them() -> None:
    arrived = sorted([*SENT, Seen(3, 12 * SECOND + 1)], key=lambda seen: seen.time_ns)
    assert verdict(arrived, window(10, 11, 20)).wrong == ['duplicated 1, allowed none']
    allowed = verdict(arrived, window(10, 11, 20), Allowance(duplicated=True))
    assert (allowed.duplicated, allowed.wrong) == (1, [])
    assert verdict(arrived, window(21, 22, 29), since_s=20).duplicated == 0


def test_disorder_is_held_against_its_bound() -> None:
    arrived = at(0, 1, 2, 5, 3, 4, *range(6, 30))
    assert verdict(arrived, window(2, 3, 20)).wrong == ['out of order 2, allowed 0']
    assert verdict(arrived, window(2, 3, 20), Allowance(out_of_order=2)).wrong == []


def test_a_fault_that_is_aimed_at_another_stream_has_no_recovery_here() -> None:
    aimed = window(10, 11, 20)._replace(target='other')
    assert verdict(SENT, aimed).recovery_s is None
    assert verdict(SENT, aimed._replace(target='s')).recovery_s == 0.0


def test_a_stream_that_never_flows_again_is_wrong() -> None:
    here = verdict(at(*range(12)), window(10, 13, 29)._replace(late=['s']), Allowance(lost=99))
    assert here.wrong == ['does not flow again']
    assert here.recovery_s is None
    assert here.stall_s == 18.0


def test_the_longest_stall_reaches_to_both_ends_of_a_window() -> None:
    times = [s * SECOND for s in (1, 2, 6, 7)]
    assert longest_gap(times, 0, 8 * SECOND) == (4 * SECOND, 2 * SECOND)
    assert longest_gap(times, 2 * SECOND + 1, 5 * SECOND) == (3 * SECOND - 1, 2 * SECOND + 1)
    assert longest_gap([], 0, 3 * SECOND) == (3 * SECOND, 0)


def test_one_line_that_stalls_is_seen_though_the_others_flow() -> None:
    # Of the odd ones, nothing comes from 9 to 20, the even ones go on.
    late = [seen for seen in SENT if seen.number % 2 and 10 < seen.number < 20]
    arrived = [seen for seen in SENT if seen not in late]
    arrived += [seen._replace(time_ns=20 * SECOND) for seen in late]
    here = ends(SENT, sorted(arrived, key=lambda seen: (seen.time_ns, seen.number)), lines=2)
    found = judge('s', here, compare(here), window(10, 12, 29), 0, Allowance())
    assert (found.stall_s, found.recovery_s, found.wrong) == (10.0, 8.0, [])


def test_a_take_over_ends_with_the_stall_and_not_with_what_was_on_its_way() -> None:
    arrived = without(*range(12, 19))
    taken = window(10, 10, 29)._replace(by_another=True)
    found = verdict(arrived, taken, Allowance(lost=7))
    assert (found.recovery_s, found.wrong) == (8.0, [])


def test_a_row_takes_the_worst_of_its_verdicts() -> None:
    slow = verdict(without(*range(10, 25)), window(10, 12, 29), Allowance(lost=20))
    quick = verdict(SENT, window(10, 12, 29))
    row = summed([quick, slow], required_s=10.0, why='')
    assert (row.times, row.lost, row.bound, row.recovery_s) == (2, 15, 20, 13.0)
    assert row.recoveries == Spread(0.0, 6.5, 13.0, 13.0)
    assert row.in_time is False
    assert summed([quick], required_s=10.0, why='').in_time is True
    assert summed([quick, slow], required_s=None, why='').in_time is None


def test_times_are_told_by_how_they_lie() -> None:
    assert spread([2.0]) == Spread(2.0, 2.0, 2.0, 2.0)
    assert spread([3.0, 1.0, 2.0]) == Spread(1.0, 2.0, 3.0, 3.0)
    assert spread([float(number) for number in range(100, 0, -1)]) == Spread(1, 50.5, 95, 100)


def test_repeats_that_a_reader_can_leave_out_are_told_from_others() -> None:
    one, two = 'aa' * 16, 'bb' * 16
    records = [(0, (one, 1)), (1, (one, 2)), (1, (one, 2)), (2, (one, 3))]
    assert not_removable(records) == []
    assert not_removable([*records, (2, (two, 1)), (2, None)]) == [2, 2]


def test_firsts_keeps_the_first_coming() -> None:
    assert numbers(firsts(at(1, 2, 1, 3))) == [1, 2, 3]


# What goes in: journals and plans


def test_what_a_killed_publisher_had_not_given_away_is_not_counted() -> None:
    entries = [
        Entry('begun', 0, 77), *(Entry('sent', n, n) for n in range(4)), Entry('acked', 9, 1),
        Entry('begun', 10, 78), Entry('sent', 11, 4), Entry('hostile', 12, 5),
    ]  # fmt: skip
    assert uncounted(entries, is_from_kafka=False) == {2, 3}
    assert uncounted(entries, is_from_kafka=True) == set()


def test_a_line_that_is_being_written_is_read_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / 'journal'
    tail = Tail(file)
    assert tail() == []
    Journal(file).write('sent', 1)
    with file.open('ab') as half:
        half.write(b'sent 12')
    assert [entry.number for entry in tail()] == [1]
    with file.open('ab') as half:
        half.write(b'3 2\n')
    assert tail() == [Entry('sent', 123, 2)]
    assert [entry.number for entry in read(file)] == [1, 2]


def test_a_seed_repeats_its_plan_and_each_fault_comes_before_one_comes_again() -> None:
    faults = list(FAULTS.values())
    plan = make_plan(7, faults, minutes=20)
    assert plan == make_plan(7, faults, minutes=20)
    assert plan != make_plan(8, faults, minutes=20)
    names = [step.fault for step in plan]
    assert set(names[: len(faults)]) == set(FAULTS)
    assert len(names) > len(faults)
    assert len(make_plan(7, faults, minutes=0.01)) == len(faults)
    often = [step.fault for step in make_plan(7, faults, minutes=0.01, times=3)]
    assert sorted(often) == sorted([fault.name for fault in faults] * 3)
    assert len(make_plan(7, faults[:2], minutes=20, times=3)) == 6


def test_what_a_fault_may_cost_is_that_of_the_guarantees() -> None:
    kill = FAULTS['bridge_kill'].allows
    assert kill(FROM_KAFKA, 0.0) == Allowance(duplicated=True)
    assert kill(LATCHED, 0.0) == Allowance()
    assert kill(VOLATILE, 0.0).lost > kill(SPOOLED_ALWAYS, 0.0).lost > 0
    stop = FAULTS['bridge_stop'].allows
    assert stop(VOLATILE, 30.0).lost_while_away, 'beyond the lease'
    assert stop(VOLATILE, 8.0) == Allowance()
    for stream in (LATCHED, VOLATILE, SPOOLED_ALWAYS):
        for name in ('cut_kafka', 'hostile', 'clock'):
            assert FAULTS[name].allows(stream, 5.0) == Allowance(), name
        for name in ('broker_kill', 'leader_kill', 'disk_full'):
            assert FAULTS[name].allows(stream, 5.0) == Allowance(duplicated=True), name


LOG = """\
2026-11-23 14:37:31,162 INFO    plain: takes over: this bridge runs the route
2026-11-23 14:37:31,169 INFO    plain: subscribes to /plain (reliable, volatile)
2026-11-23 14:37:31,200 INFO    other: takes over: this bridge runs the route
2026-11-23 14:37:41,029 INFO    plain: running: 375 confirmed, 37/s, 330 in flight
2026-11-23 14:37:59,777 INFO    plain: takes over: this bridge runs the route
2026-11-23 14:37:59,794 WARNING plain: hands over: another bridge runs this route
2026-11-23 14:38:02,000 WARNING to_ros: lost t[0, 1]: Kafka has not heard of this bridge
2026-11-23 14:38:03,500 INFO    to_ros: hands over t[2]
""".splitlines()


def test_hand_overs_are_read_from_what_the_bridges_say() -> None:
    def after_s(route: str, *, is_from_kafka: bool) -> list[float]:
        found = said.hand_overs_ns(route, LOG, is_from_kafka=is_from_kafka)
        start = datetime(2026, 11, 23, 14, 37).astimezone().timestamp()
        return [round(at_ns / 1e9 - start, 3) for at_ns in found]

    assert after_s('plain', is_from_kafka=False) == [59.777, 59.794], (
        'the first has it from nobody'
    )
    assert after_s('other', is_from_kafka=False) == []
    assert after_s('to_ros', is_from_kafka=True) == [62.0, 63.5]


def test_a_stream_that_stands_still_is_reported_with_what_its_bridge_said_last() -> None:
    assert said.last_of('plain', LOG).endswith('hands over: another bridge runs this route')
    assert said.last_of('nobody', LOG) == 'nothing'
