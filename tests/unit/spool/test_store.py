"""The queue on disk, as long as its file is well."""

import os
import stat
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.spools.files import (
    EVERYTHING,
    GID,
    make,
    numbers,
    opened,
    read_all,
    reopened,
    row,
    rows,
)

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import RouteError, SpoolInUseError
from ros2_kafka_bridge.spool.ages import Older
from ros2_kafka_bridge.spool.lock import is_in_use, lock_of
from ros2_kafka_bridge.spool.rows import Row, size_of
from ros2_kafka_bridge.spool.store import file_of

texts = st.text(max_size=20)  # without lone surrogates: Kafka has none either
any_bytes = st.binary(max_size=6000)
records = st.builds(
    Outgoing,
    texts,
    st.none() | any_bytes,
    st.none() | any_bytes,
    st.lists(st.tuples(texts, st.none() | texts | st.binary(max_size=40)), max_size=5),
)
any_rows = st.builds(
    Row,
    st.just(0),
    st.integers(0, 2**63 - 1),
    st.booleans(),
    st.binary(max_size=24),
    st.integers(0, 2**63 - 1),
    records,
)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(any_rows, min_size=1, max_size=6))
def test_every_record_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, given_rows: list[Row]
) -> None:
    path = tmp_path_factory.mktemp('spool')
    written = [one._replace(number=n) for n, one in enumerate(given_rows, 1)]
    with opened(path) as spool:
        spool.append(written)
        assert read_all(spool) == written
        assert spool.size_bytes == sum(size_of(one.record) for one in written)
    again = reopened(path)
    assert again.rows == written
    types = [[type(text) for _, text in one.record.headers] for one in written]
    assert [[type(text) for _, text in one.record.headers] for one in again.rows] == types


def test_a_new_one_is_empty(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        assert (spool.first, spool.last, spool.count, spool.size_bytes) == (0, 0, 0, 0)
        assert spool.read(0, 10, EVERYTHING) == []
        assert list(spool.numbers()) == []
        assert spool.count_after(0) == 0
        assert spool.take_lost() == 0


def test_its_ends_and_sizes_are_found_again(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        assert spool.append(rows(1, 20)) == 1
        assert spool.append(rows(21, 30)) == 21
        spool.delete_before(10)
        state = (spool.first, spool.last, spool.count, spool.size_bytes)
        assert state[:3] == (10, 30, 21)
    with opened(tmp_path) as spool:
        assert (spool.first, spool.last, spool.count, spool.size_bytes) == state


def test_reading_keeps_to_its_limits_but_for_the_first_row(tmp_path: Path) -> None:
    with opened(tmp_path, 20, size=1000) as spool:
        assert numbers(spool.read(0, 5, EVERYTHING)) == [1, 2, 3, 4, 5]
        assert numbers(spool.read(5, 100, 2500)) == [6, 7, 8]
        assert numbers(spool.read(8, 100, 1)) == [9]
        assert numbers(spool.read(18, 100, EVERYTHING)) == [19, 20]
        assert spool.read(20, 100, EVERYTHING) == []


def test_numbers_go_on_also_where_it_was_empty(tmp_path: Path) -> None:
    for first in (1, 51, 101):
        with opened(tmp_path) as spool:
            assert spool.append(rows(1, 50)) == first
            assert (spool.first, spool.last) == (first, first + 49)
            assert numbers(read_all(spool)) == list(range(first, first + 50))
            spool.delete_before(first + 50)
            assert (spool.first, spool.last, spool.count) == (0, first + 49, 0)


def test_numbers_that_were_dropped_at_the_end_are_not_given_again(tmp_path: Path) -> None:
    with opened(tmp_path, 10) as spool:
        assert spool.discard_between(6, 10, keep=frozenset()) == 5
    with opened(tmp_path) as spool:
        assert (spool.count, spool.last) == (5, 10)
        spool.append(rows(11, 12))
        assert numbers(read_all(spool)) == [1, 2, 3, 4, 5, 11, 12]


def test_it_tells_publisher_and_number_of_those_that_have_them(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        spool.append([row(1), row(2)._replace(gid=b''), row(3)._replace(seq=0), row(4)])
        assert list(spool.numbers()) == [(GID, 1), (GID, 4)]


def test_it_tells_them_in_order_however_many_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.store._READ', 4)
    with opened(tmp_path, 12) as spool:
        spool.delete_before(13)
        without = [row(number)._replace(gid=b'') for number in range(13, 22)]
        spool.append([*without, *rows(22, 24)])
        spool.append(rows(25, 33))
        assert list(spool.numbers()) == [(GID, number) for number in range(22, 34)]
        found = spool.numbers()
        assert next(found) == (GID, 22)
        spool.delete_before(29)  # while somebody reads
        assert list(found)[-5:] == [(GID, number) for number in range(29, 34)]


def test_it_counts_the_rows_above_a_number(tmp_path: Path) -> None:
    with opened(tmp_path, 50) as spool:
        spool.delete_before(51)
        spool.append(rows(1, 20))
        spool.discard_between(55, 60, keep=frozenset({57}))
        counts = {after: spool.count_after(after) for after in (0, 54, 57, 69, 70, 1000)}
        assert counts == {0: 15, 54: 11, 57: 10, 69: 1, 70: 0, 1000: 0}
        assert spool.count_after(0) == spool.count


def test_the_oldest_are_dropped_until_there_is_room(tmp_path: Path) -> None:
    with opened(tmp_path, 20, size=900) as spool:
        size_bytes = spool.size_bytes
        assert spool.drop_oldest(3, 2500) == 3
        assert numbers(read_all(spool)) == [1, 2, 3, *range(7, 21)]
        assert size_bytes - spool.size_bytes >= 2500
        assert spool.drop_oldest(3, EVERYTHING) == 13, 'the newest stays'
        assert spool.drop_oldest(20, 1) == 0


def test_the_oldest_are_dropped_when_they_are_too_old(tmp_path: Path) -> None:
    with opened(tmp_path, 20) as spool:
        older = Older(21, 0, row(8).taken_ns)
        assert spool.drop_older(3, older) == (4, False)
        assert numbers(read_all(spool)) == [1, 2, 3, *range(8, 21)]
        assert spool.drop_older(3, older) == (0, False)
        assert spool.drop_older(0, older._replace(until_ns=row(100).taken_ns)) == (16, True)
        assert spool.count == 0


def test_what_has_ended_between_others_is_discarded(tmp_path: Path) -> None:
    with opened(tmp_path, 20) as spool:
        assert spool.discard_between(3, 12, keep=frozenset({3, 7, 8, 11})) == 6
    assert numbers(reopened(tmp_path).rows) == [1, 2, 3, 7, 8, 11, *range(13, 21)]


def test_the_file_is_small_again_after_a_long_backlog(tmp_path: Path) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    with opened(tmp_path) as spool:
        for first in range(1, 30_000, 1000):
            spool.append(rows(first, first + 999, size=1000))
        assert file.stat().st_size > 20_000_000
        for before in range(1000, 30_000, 1000):
            spool.delete_before(before)
        assert spool.count == 1001
        assert file.stat().st_size < 20_000_000, 'also while some are left'
        spool.delete_before(30_001)
    assert file.stat().st_size < 100_000
    assert not file.with_name(f'{file.name}-wal').exists()


def test_the_file_does_not_grow_while_rows_come_and_go(tmp_path: Path) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    with opened(tmp_path) as spool:
        for first in range(1, 50_000, 500):
            spool.append(rows(first, first + 499, size=200))
            spool.delete_before(first)
        assert file.stat().st_size < 10_000_000
        assert file.with_name(f'{file.name}-wal').stat().st_size < 10_000_000


def test_nobody_else_may_read_its_files(tmp_path: Path) -> None:
    place = tmp_path / 'deep' / 'inside'
    with opened(place) as spool:
        spool.append(rows(1, 10))
        assert stat.S_IMODE(place.stat().st_mode) == 0o700
        assert stat.S_IMODE(place.parent.stat().st_mode) == 0o700
        modes = {file.suffix: stat.S_IMODE(file.stat().st_mode) for file in place.iterdir()}
    assert modes == {'.spool': 0o600, '.spool-wal': 0o600, '.spool-shm': 0o600, '.lock': 0o600}


def test_a_file_that_all_may_read_is_closed_to_them(tmp_path: Path) -> None:
    with opened(tmp_path, 10):
        pass
    file = file_of(tmp_path, 'bridge', 'route')
    file.chmod(0o644)
    with opened(tmp_path):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_a_spool_that_is_claimed_stays_with_its_process_between_two_runs(tmp_path: Path) -> None:
    """A bridge that stands by on the same machine would deliver it meanwhile."""
    file = lock_of(file_of(tmp_path, 'bridge', 'route'))
    assert not is_in_use(file)
    spool, other = make(tmp_path), make(tmp_path)
    spool.claim()
    assert is_in_use(file)
    spool.open()
    spool.append(rows(1, 10))
    spool.close()
    assert is_in_use(file)
    with pytest.raises(SpoolInUseError, match=f'pid {os.getpid()}'):
        other.claim()
    spool.open()
    assert spool.count == 10
    spool.release()
    assert not is_in_use(file)
    other.claim()
    other.open()
    assert other.count == 10
    other.release()


def test_a_second_process_is_told_who_has_it(tmp_path: Path) -> None:
    with opened(tmp_path), pytest.raises(RouteError) as raised:
        make(tmp_path).open()
    assert f'another process uses this spool (pid {os.getpid()})' in str(raised.value)
    with opened(tmp_path):
        pass  # it is free again


def test_it_can_be_closed_twice_and_opened_again(tmp_path: Path) -> None:
    spool = make(tmp_path)
    spool.close()
    spool.open()
    spool.append(rows(1, 3))
    spool.close()
    spool.close()
    spool.open()
    spool.append(rows(4, 5))
    assert numbers(read_all(spool)) == [1, 2, 3, 4, 5]
    spool.close()


def test_a_directory_in_its_place_is_refused(tmp_path: Path) -> None:
    file_of(tmp_path, 'bridge', 'route').mkdir()
    with pytest.raises(RouteError, match=r'bridge\.route\.spool is a directory: move it away'):
        make(tmp_path).open()


def test_a_file_in_place_of_the_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('x')
    for place in (tmp_path / 'file', tmp_path / 'file' / 'below'):
        with pytest.raises(RouteError, match=r'spool\.path'):
            make(place).open()


def test_a_link_in_its_place_is_refused(tmp_path: Path) -> None:
    target = tmp_path / 'target'
    target.write_text('')
    file_of(tmp_path, 'bridge', 'route').symlink_to(target)
    with pytest.raises(RouteError, match='no regular file'):
        make(tmp_path).open()
    assert target.read_text() == ''


@pytest.mark.parametrize('suffix', ['-wal', '-shm'])
def test_a_link_beside_it_is_refused_and_not_followed(tmp_path: Path, suffix: str) -> None:
    with opened(tmp_path / 'spool') as spool:
        spool.append(rows(1, 10))
    target = tmp_path / 'target'
    target.write_text('a diary')
    target.chmod(0o644)
    file = file_of(tmp_path / 'spool', 'bridge', 'route')
    link = file.with_name(f'{file.name}{suffix}')
    link.symlink_to(target)
    with pytest.raises(RouteError, match=f'{suffix} is no regular file: move it away'):
        make(tmp_path / 'spool').open()
    assert (stat.S_IMODE(target.stat().st_mode), target.read_text()) == (0o644, 'a diary')
    assert link.is_symlink()
    link.unlink()
    assert numbers(reopened(tmp_path / 'spool').rows) == list(range(1, 11))


def test_a_link_that_appears_later_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / 'target'
    target.write_text('')
    target.chmod(0o644)
    file = file_of(tmp_path, 'bridge', 'route')

    def plant(*_: object) -> None:
        file.with_name(f'{file.name}-wal').symlink_to(target)

    monkeypatch.setattr('ros2_kafka_bridge.spool.repair.repair', plant)
    with pytest.raises(RouteError, match='-wal is no regular file'):
        make(tmp_path).open()
    assert stat.S_IMODE(target.stat().st_mode) == 0o644


@pytest.mark.parametrize(
    'content',
    [b'a diary', b'\0' * 20_000, b'SQLite format 3\0' + b'\1' * 9000, os.urandom(50_000)],
)
def test_a_file_that_is_something_else_is_never_touched(tmp_path: Path, content: bytes) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    file.write_bytes(content)
    with pytest.raises(RouteError, match='is not a spool: move it away'):
        make(tmp_path).open()
    assert file.read_bytes() == content


def test_a_newer_version_is_refused_and_not_touched(tmp_path: Path) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    with opened(tmp_path, 10):
        pass
    content = bytearray(file.read_bytes())
    content[60:64] = (2).to_bytes(4)
    content = content.replace(b'RKBSPOOL\1', b'RKBSPOOL\2')
    file.write_bytes(content)
    with pytest.raises(RouteError, match='is of version 2, this program reads version 1: update'):
        make(tmp_path).open()
    assert file.read_bytes() == content
