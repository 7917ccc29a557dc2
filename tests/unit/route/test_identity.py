"""What others write proves nothing (guarantee 6b): real headers, and those that strangers make."""

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.kafka.identities import headers_by, identify

from ros2_kafka_bridge.dedup import place_in
from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.route import identity as under_test
from ros2_kafka_bridge.route.identity import Author, Evidence, Identity, make_loop_check
from ros2_kafka_bridge.route.type_hash import make_hash_check

GID, OTHER = bytes(range(16)), bytes(range(16, 32))
NOW_NS = 1_795_700_000_123_456_789
MESSAGE = Identity(GID, 7, NOW_NS)


def changed(headers: HeaderList, name: str, value: bytes | None) -> HeaderList:
    """The same with another value; without the header where that is None."""
    told = [(n, value if n == name else v) for n, v in headers]
    return [one for one in told if one != (name, None)]


def noted(*headers: HeaderList) -> Evidence:
    """What records with these headers show."""
    evidence = Evidence()
    for one in headers:
        identity = identify(one)
        if identity is not None:
            evidence.note(identity)
    return evidence


def test_guarantee_6b_a_record_of_the_route_proves_its_message_and_no_other() -> None:
    evidence = noted(headers_by(*MESSAGE))
    assert evidence.proves(MESSAGE)
    for other in (
        MESSAGE._replace(gid=OTHER),
        MESSAGE._replace(seq=8),
        MESSAGE._replace(source_time_ns=NOW_NS + 1001),
        MESSAGE._replace(source_time_ns=0),
    ):
        assert not evidence.proves(other)


@pytest.mark.parametrize('off_ns', [-1000, -1, 1, 999, 1000])
def test_transports_may_round_the_time_of_a_message_by_a_microsecond(off_ns: int) -> None:
    sent_again = MESSAGE._replace(source_time_ns=NOW_NS + off_ns)
    assert noted(headers_by(*MESSAGE)).proves(sent_again)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('ros.topic', b'/status'),
        ('ros.topic', None),
        ('bridge.origin', b'another'),
        ('bridge.origin', None),
        ('bridge.route', b'orders2'),
        ('bridge.route', None),  # as an earlier version of the bridge wrote it
        ('ros.source_time_ns', b'%d' % (NOW_NS - 2000)),
        ('ros.source_time_ns', b'0'),
        ('ros.source_time_ns', b'-5'),
        ('ros.source_time_ns', None),
    ],
)
def test_guarantee_6b_a_record_that_lacks_a_part_of_it_proves_nothing_and_is_told(
    name: str, value: bytes | None
) -> None:
    evidence = noted(changed(headers_by(*MESSAGE), name, value))
    assert not evidence.proves(MESSAGE)
    assert evidence.claims(MESSAGE)
    assert not evidence.claims(MESSAGE._replace(seq=8))


def test_a_forged_record_beside_the_true_one_takes_nothing_from_it() -> None:
    true = headers_by(*MESSAGE)
    forged = [headers_by(GID, 7, NOW_NS + off) for off in (-(10**9), 5000, 10**9)]
    assert noted(*forged, true, *forged).proves(MESSAGE)
    assert not noted(*forged).proves(MESSAGE)


@pytest.mark.parametrize(
    ('gid', 'seq'),
    [
        (b'ab' * 450_000, b'7'),
        (b'ab' * 15, b'7'),
        (b'AB' * 16, b'7'),
        (b'ab ' * 10 + b'ab', b'7'),
        (b'\xff' * 32, b'7'),
        (None, b'7'),
        (GID.hex().encode(), b'7' * 20),
        (GID.hex().encode(), b'7' * 5000),
        (GID.hex().encode(), b' 7'),
        (GID.hex().encode(), b'+7'),
        (GID.hex().encode(), b'1_0'),
        (GID.hex().encode(), '\u0667'.encode()),
        (GID.hex().encode(), b''),
        (GID.hex().encode(), None),
    ],
)
def test_what_does_not_look_like_a_publisher_and_a_number_is_not_looked_at(
    gid: bytes | None, seq: bytes | None
) -> None:
    headers = changed(changed(headers_by(*MESSAGE), 'ros.gid', gid), 'ros.seq', seq)
    assert place_in(headers) is None
    assert identify(headers) is None


def test_numbers_that_no_int64_holds_end_nothing() -> None:
    largest = b'9' * 19
    assert identify(changed(headers_by(*MESSAGE), 'ros.seq', largest)) is None
    timed = changed(headers_by(*MESSAGE), 'ros.source_time_ns', largest)
    assert identify(timed) == MESSAGE._replace(source_time_ns=0)
    evidence = noted(headers_by(GID, 2**63 - 1, 2**63 - 1))
    assert evidence.proves(Identity(GID, 2**63 - 1, 2**63 - 1))


@given(
    st.lists(
        st.tuples(st.sampled_from([GID, OTHER]), st.integers(1, 9), st.integers(1, 4)),
        max_size=60,
    ),
    st.integers(0, 60),
)
def test_in_whatever_order_they_were_noted_exactly_those_are_there(
    found: list[tuple[bytes, int, int]], at: int
) -> None:
    """Read backwards, with forged ones in between; asked in the middle, too."""
    evidence, plain = Evidence(), set[Identity]()
    for number, (gid, seq, hour) in enumerate(found):
        one = Identity(gid, seq, hour * 3_600_000_000_000)
        evidence.note(one)
        plain.add(one)
        if number == at:
            assert evidence.proves(one)
    for gid in (GID, OTHER):
        seqs = [one.seq for one in plain if one.gid == gid]
        assert evidence.first(gid) == min(seqs, default=None)
        for seq in range(1, 11):
            claimed = evidence.claims(Identity(gid, seq, 1))
            assert claimed == (seq in seqs)
            for hour in range(1, 5):
                one = Identity(gid, seq, hour * 3_600_000_000_000)
                assert evidence.proves(one) == (one in plain)


def test_memory_is_bounded_whatever_is_read() -> None:
    count = 100_000
    tracemalloc.start()
    try:
        evidence = Evidence()
        for seq in range(1, count + 1):
            evidence.note(Identity(GID, seq * 1_000_003, NOW_NS + seq))
        proved_bytes, _ = tracemalloc.get_traced_memory()
        assert evidence.proves(Identity(GID, 1_000_003, NOW_NS + 1))
        for seq in range(1, count + 1):
            evidence.note(Identity(OTHER, seq * 1_000_003, 0))
        claimed_bytes = tracemalloc.get_traced_memory()[0] - proved_bytes
    finally:
        tracemalloc.stop()
    assert proved_bytes < 25 * count, 'two int64 a message, and the room of a growing array'
    assert claimed_bytes < 25 * count


@pytest.mark.parametrize('made_ns', [NOW_NS, 0])
def test_of_more_publishers_than_it_remembers_the_last_ones_are_known(
    made_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(under_test, 'MAX_PUBLISHERS', 10)
    evidence = Evidence()
    for number in range(25):
        evidence.note(Identity(number.to_bytes(16), 1, made_ns))
    known = [n for n in range(25) if evidence.claims(Identity(n.to_bytes(16), 1, NOW_NS))]
    assert known == list(range(15, 25))


def test_guarantee_6b_a_message_that_tells_too_little_is_never_known() -> None:
    """A stranger writes a time near 1970, or the number 0, for one that has none."""
    evidence = noted(headers_by(GID, 7, 500), changed(headers_by(*MESSAGE), 'ros.seq', b'0'))
    for poor in (Identity(GID, 7, 0), Identity(GID, 0, NOW_NS), Identity(b'', 0, NOW_NS)):
        assert not evidence.proves(poor)


def test_made_up_publishers_of_older_records_push_nobody_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(under_test, 'MAX_PUBLISHERS', 10)
    evidence = noted(headers_by(*MESSAGE))
    for number in range(100, 125):
        evidence.note(Identity(number.to_bytes(16), 1, NOW_NS), is_older=True)
    evidence.note(MESSAGE._replace(seq=6), is_older=True)
    assert evidence.proves(MESSAGE)
    assert evidence.first(GID) == 6


# What would go round


def test_a_record_goes_round_where_it_came_from_the_topic_by_this_bridge() -> None:
    goes_round = make_loop_check('test', '/orders')
    assert goes_round(headers_by(*MESSAGE))
    assert goes_round(headers_by(*MESSAGE, Author('/orders', 'test', 'another route')))
    assert goes_round([('bridge.origin', b'other'), *headers_by(*MESSAGE)]), (
        'a job that adds its own'
    )
    assert not goes_round(headers_by(*MESSAGE, Author('/status', 'test', 'orders')))
    assert not goes_round(headers_by(*MESSAGE, Author('/orders', 'test-2', 'orders')))
    assert not goes_round([])


@pytest.mark.parametrize('any_type', [False, True])
def test_the_copied_hash_of_another_type_is_left_to_a_format_that_tells_what_it_holds(
    *, any_type: bool
) -> None:
    """A processor that reads odometry and writes commands copies `ros.type_hash`, too."""
    here, there = (f'RIHS01_{digit * 64}' for digit in '12')
    check = make_hash_check('geometry_msgs/msg/Twist', here, any_type=any_type)
    copied: HeaderList = [
        ('ros.type', b'nav_msgs/msg/Odometry'),
        ('ros.type_hash', there.encode()),
    ]
    if any_type:
        check(copied)
    else:
        with pytest.raises(DecodeError, match='a program has copied the header'):
            check(copied)
    for of_this_type in (changed(copied, 'ros.type', b'geometry_msgs/msg/Twist'), copied[1:]):
        with pytest.raises(DecodeError, match=there):
            check(of_this_type)
