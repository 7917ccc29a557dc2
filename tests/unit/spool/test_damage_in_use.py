"""A spool whose file is damaged while it is open."""

import re
import sqlite3
from pathlib import Path

import pytest
from support.spools.files import EVERYTHING, GID, numbers, opened, read_all, rows
from support.worlds.pipeline_with_spool import Make, go_on

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.spool.store import file_of


def test_damage_while_it_is_open_is_repaired_on_the_way(tmp_path: Path) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    with opened(tmp_path) as spool:
        for first in range(1, 5001, 500):
            spool.append(rows(first, first + 499, size=2000))
        spool.delete_before(11)
        first_half = spool.read(0, 2000, EVERYTHING)
        with sqlite3.connect(file) as other:
            other.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        other.close()
        content = bytearray(file.read_bytes())
        content[content.index(b'4000 4000 ')] ^= 255
        with file.open('r+b') as written:
            written.write(content)
        found = list(first_half)
        while part := spool.read(found[-1].number, 500, EVERYTHING):
            found += part
        assert numbers(found) == [n for n in range(11, 5001) if n != 4000]
        assert spool.take_lost() == 1
        assert len(list(tmp_path.glob('*.damaged-*'))) == 1
        spool.append(rows(5001, 5010))
        spool.delete_before(5001)
        assert numbers(read_all(spool)) == list(range(5001, 5011))


def test_a_damaged_message_is_counted_as_lost_and_no_other_waits_for_it(
    house: Make, caplog: pytest.LogCaptureFixture
) -> None:
    h = house(max_in_flight=2, away=True)
    h.take(*range(1, 11))
    with sqlite3.connect(h.spool._path) as other:
        other.execute("UPDATE rows SET body = x'00' WHERE number = 6")
    other.close()
    go_on(h, 11)
    assert h.numbers() == [1, 2, 3, 4, 5, 7, 8, 9, 10, 11]
    assert (h.count('taken'), h.count('confirmed'), h.count('lost')) == (11, 10, 1)
    assert '1 message in the spool cannot be read: lost' in caplog.text


def test_damage_is_repaired_also_while_the_numbers_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.spool.store._READ', 100)
    file = file_of(tmp_path, 'bridge', 'route')
    with opened(tmp_path) as spool:
        for first in range(1, 5001, 500):
            spool.append(rows(first, first + 499))
        told = spool.numbers()
        found = [next(told) for _ in range(150)]
        with sqlite3.connect(file) as other:
            other.execute("UPDATE rows SET gid = 'no bytes' WHERE number = 4000")
        other.close()
        found += told
        assert found == [(GID, n) for n in range(1, 5001) if n != 4000]
        assert spool.count_after(3990) == 1009
        assert spool.take_lost() == 1


def test_a_disk_that_keeps_damaging_it_fails_the_route(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(tmp_path, 10) as spool:
        monkeypatch.setattr('ros2_kafka_bridge.spool.database.unpack', lambda *_: None)
        with pytest.raises(RouteError, match=re.escape('damaged again as soon as it is repaired')):
            spool.read(0, 10, EVERYTHING)
