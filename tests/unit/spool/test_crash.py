"""A spool whose process is killed, or whose disk is full."""

import errno
import os
import random
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.processes.lifetimes import ended
from support.spools.files import GID, make, numbers, opened, read_all, reopened, rows
from support.spools.small_disks import fill, mounted

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.spool.store import Spool, file_of

_WRITER = Path(__file__).parents[2] / 'peers' / 'spool_writer.py'
_KILLS = 5


def killed(place: Path, sync: str, lines: int) -> tuple[int, int]:
    """Let a process write until it has said so many lines, then kill it.

    Returns:
        The lowest and the highest number that must be in the spool.
    """
    command = [sys.executable, str(_WRITER), str(place), sync]
    first, last = 1, 0
    with ended(subprocess.Popen(command, stdout=subprocess.PIPE, text=True)) as writer:
        assert writer.stdout is not None
        for number, line in enumerate(writer.stdout):
            if number == lines:
                writer.kill()
            what, value = line.split()
            if what == 'release':
                first = int(value)
            else:
                last = int(value)
    return first, last


@pytest.mark.parametrize('sync', ['sync', 'no sync'])
def test_nothing_that_append_returned_for_is_lost_by_sigkill(tmp_path: Path, sync: str) -> None:
    chance = random.Random(sync)  # noqa: S311 (moments, no secrets)
    first = 1
    for _ in range(_KILLS):
        released, last = killed(tmp_path, sync, chance.randrange(1, 60))
        first = max(first, released)
        with opened(tmp_path) as spool:
            assert spool.damage is None
            found = read_all(spool)
            held = numbers(found)
            assert held == list(range(held[0], held[-1] + 1))
            assert held[0] <= first
            assert held[-1] >= last
            assert {(GID, number) for number in held} == set(spool.numbers())
            assert all(one.gid == GID and one.seq == one.number for one in found)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MB."""
    with mounted(tmp_path / 'disk', '3m') as place:
        yield place


def append_until_full(spool: Spool) -> int:
    """Append until the disk is full; the number of the last row that is in the spool."""
    last = spool.last
    while True:
        try:
            spool.append(rows(last + 1, last + 50, size=1000))
        except TransportError:
            return last
        last += 50


def test_a_full_disk_takes_a_batch_whole_or_not_at_all(small_disk: Path) -> None:
    with opened(small_disk) as spool:
        last = append_until_full(spool)
        assert last > 500
        with pytest.raises(TransportError) as raised:
            spool.append(rows(last + 1, last + 50, size=1000))
        said = str(raised.value)
        assert str(file_of(small_disk, 'bridge', 'route')) in said
        assert 'cannot be written: database or disk is full' in said
        assert 'MB free on its disk' in said
        assert (spool.last, spool.count) == (last, last)
        assert numbers(read_all(spool)) == list(range(1, last + 1))
    assert numbers(reopened(small_disk).rows) == list(range(1, last + 1))


def test_what_was_delivered_from_a_full_disk_makes_room(small_disk: Path) -> None:
    with opened(small_disk) as spool:
        last = append_until_full(spool)
        fill(small_disk)
        assert numbers(read_all(spool)) == list(range(1, last + 1))
        try:
            spool.delete_before(last // 2)
        except TransportError:
            assert spool.count == last
        spool.delete_before(last + 1)
        assert spool.count == 0
        spool.append(rows(last + 1, last + 100, size=1000))
        assert numbers(read_all(spool)) == list(range(last + 1, last + 101))
        assert spool.take_lost() == 0
    assert numbers(reopened(small_disk).rows) == list(range(last + 1, last + 101))


@pytest.mark.parametrize(
    'call', ['lock.FileLock.keep', 'database.remove'], ids=['not noted', 'not deleted']
)
def test_a_disk_that_refuses_also_a_new_file_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    full = sqlite3.OperationalError('database or disk is full')
    full.sqlite_errorcode = sqlite3.SQLITE_FULL

    def refuse(*_: object) -> None:
        raise full

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with opened(tmp_path, 10) as spool:
        with monkeypatch.context() as patch:
            patch.setattr('ros2_kafka_bridge.spool.database.write_ledger', refuse)
            patch.setattr(f'ros2_kafka_bridge.spool.{call}', fail)
            with pytest.raises(TransportError, match='cannot be deleted: Input/output error'):
                spool.delete_before(11)
        assert numbers(read_all(spool)) == list(range(1, 11)), 'it is the file that it was'
        assert spool.damage is None
        spool.delete_before(11)
        spool.append(rows(11, 12))
        assert numbers(read_all(spool)) == [11, 12]
        assert spool.take_lost() == 0


def test_there_is_room_again_once_somebody_makes_it(small_disk: Path) -> None:
    with opened(small_disk) as spool:
        spool.append(rows(1, 100, size=1000))
        ballast = fill(small_disk)
        last = append_until_full(spool)
        ballast.unlink()
        spool.append(rows(last + 1, last + 50, size=1000))
        assert numbers(read_all(spool)) == list(range(1, last + 51))


def test_without_room_for_a_repair_nothing_is_touched(small_disk: Path) -> None:
    file = file_of(small_disk, 'bridge', 'route')
    with opened(small_disk) as spool:
        spool.append(rows(1, 500, size=1000))
    content = bytearray(file.read_bytes())
    content[content.index(b'300 300 ')] ^= 255
    file.write_bytes(content)
    ballast = fill(small_disk)
    with pytest.raises(RouteError) as raised:
        make(small_disk).open()
    said = str(raised.value)
    assert f'the spool {file} is damaged (row 300 is not as it was written)' in said
    assert 'cannot be repaired now, nothing of it was changed' in said
    assert file.read_bytes() == content
    assert sorted(entry.name for entry in small_disk.iterdir()) == [
        'ballast',
        file.name,
        f'{file.name}.lock',
    ]
    ballast.unlink()
    found = reopened(small_disk)
    assert numbers(found.rows) == [number for number in range(1, 501) if number != 300]
    assert found.lost == 1


def test_a_spool_is_delivered_from_a_full_disk_after_a_restart(small_disk: Path) -> None:
    with opened(small_disk) as spool:
        last = append_until_full(spool)
    fill(small_disk)
    with opened(small_disk) as spool:
        assert spool.damage is None
        assert numbers(read_all(spool)) == list(range(1, last + 1))
        spool.delete_before(last + 1)
        spool.append(rows(last + 1, last + 10))
    assert numbers(reopened(small_disk).rows) == list(range(last + 1, last + 11))


def test_a_disk_without_room_for_a_new_one_is_an_error(small_disk: Path) -> None:
    fill(small_disk)
    with pytest.raises(RouteError, match=r'bridge\.route\.spool.* cannot be'):
        make(small_disk).open()
