"""A spool whose first pages are damaged, which lead to all others."""

import errno
import os
import shutil
from pathlib import Path

import pytest
from support.spools.files import Sample, beside, flip, make, overwrite, read, reopened

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.spool import database


@pytest.mark.parametrize(('page', 'is_lost'), [(1, False), (2, False), (3, True)])
def test_all_is_lost_and_counted_without_the_page_that_leads_to_all_rows(
    closed: Sample, place: Path, page: int, *, is_lost: bool
) -> None:
    sample = closed.copy(place)
    overwrite(beside(place), (page - 1) * database.PAGE_BYTES, bytes(database.PAGE_BYTES))
    assert sample.check() == is_lost * len(sample.rows)


@pytest.mark.parametrize('at', [0, 17, 19, 22, 31, 47, 59, 100, 104, 109])
def test_a_byte_of_the_header_costs_nothing(closed: Sample, place: Path, at: int) -> None:
    sample = closed.copy(place)
    flip(beside(place), at)
    assert sample.check() == 0


@pytest.mark.parametrize('text', [b'tablerows', b'rowsrows', b'CREATE TABLE rows', b'number'])
def test_a_letter_of_the_schema_costs_nothing(closed: Sample, place: Path, text: bytes) -> None:
    """With its highest bit it is no letter any more, also where SQLite names it."""
    sample = closed.copy(place)
    flip(beside(place), beside(place).read_bytes().index(text) + 1, 0x80)
    assert sample.check() == 0


def test_a_damaged_first_page_costs_nothing_of_what_is_in_the_log(
    killed: Sample, place: Path
) -> None:
    sample = killed.copy(place)
    flip(beside(place), 0)
    assert sample.check() == 0
    assert not list(place.glob('*.copy*'))


def test_without_room_for_a_copy_a_damaged_first_page_loses_nothing(
    closed: Sample, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample = closed.copy(place)
    flip(beside(place), 0)
    before = read(beside(place))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(shutil, 'copyfile', full)
        with pytest.raises(RouteError, match='cannot be repaired now, nothing of it was changed'):
            make(place).open()
    assert read(beside(place)) == before
    assert [file.suffix for file in sorted(place.iterdir())] == ['.spool', '.lock']
    assert sample.check() == 0


def test_a_damaged_place_in_a_page_that_leads_to_others_costs_one_of_those(
    closed: Sample, place: Path
) -> None:
    """Also the one in its middle, where SQLite begins to look for a row."""
    page = 2 * database.PAGE_BYTES
    content = beside(closed.place).read_bytes()
    middle = page + 12 + 2 * ((int.from_bytes(content[page + 3 : page + 5]) - 1) // 2)
    sample = closed.copy(place)
    flip(beside(place), middle)
    assert 1 <= sample.check() <= 25, 'a page of small rows holds some twenty'


def test_a_beginning_of_zeros_is_a_damaged_spool_where_the_lock_file_knows_of_one(
    closed: Sample, place: Path
) -> None:
    sample = closed.copy(place)
    overwrite(beside(place), 0, bytes(5 * database.PAGE_BYTES))
    assert sample.check() == len(sample.rows)


def test_a_beginning_that_is_of_no_spool_is_refused_and_left_as_it_is(
    closed: Sample, place: Path
) -> None:
    closed.copy(place)
    overwrite(beside(place), 0, b'a diary' * database.PAGE_BYTES)
    before = beside(place).read_bytes()
    with pytest.raises(RouteError, match='is not a spool: move it away'):
        make(place).open()
    assert beside(place).read_bytes() == before
    beside(place).unlink()
    assert reopened(place).lost == len(closed.rows)
