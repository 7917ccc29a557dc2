"""A spool whose file is damaged: what can be read is kept, the rest is counted."""

import logging
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.spools.files import (
    Sample,
    beside,
    flip,
    make,
    numbers,
    opened,
    overwrite,
    put_aside,
    read_all,
    reopened,
    rows,
    zero_page,
)

from ros2_kafka_bridge.spool import database, repair

SEVERAL = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])

# Where in a file, as a share of it: anywhere, or near its beginning.
places = st.one_of(st.floats(0, 1, exclude_max=True), st.floats(0, 0.03))


@SEVERAL
@given(at=places, bits=st.integers(1, 255))
def test_what_a_flipped_byte_costs_is_counted(
    closed: Sample, tmp_path_factory: pytest.TempPathFactory, at: float, bits: int
) -> None:
    sample = closed.copy(tmp_path_factory.mktemp('flip'))
    file = beside(sample.place)
    flip(file, int(at * file.stat().st_size), bits)
    sample.check()
    shutil.rmtree(sample.place)


@SEVERAL
@given(at=places)
def test_a_file_that_was_cut_off_gives_what_is_left_of_it(
    closed: Sample, tmp_path_factory: pytest.TempPathFactory, at: float
) -> None:
    sample = closed.copy(tmp_path_factory.mktemp('cut'))
    file = beside(sample.place)
    size = file.stat().st_size
    cut = int(at * size)
    os.truncate(file, cut)
    # A page of small rows holds some twenty; some rows have pages of their own.
    assert sample.check() <= 25 * (1 + (size - cut) // database.PAGE_BYTES)
    shutil.rmtree(sample.place)


@SEVERAL
@given(at=places, bits=st.integers(1, 255))
def test_a_flipped_byte_in_the_log_costs_what_is_in_the_log_at_most(
    killed: Sample, tmp_path_factory: pytest.TempPathFactory, at: float, bits: int
) -> None:
    sample = killed.copy(tmp_path_factory.mktemp('flip'))
    file = beside(sample.place, '-wal')
    flip(file, int(at * file.stat().st_size), bits)
    assert sample.check() <= 100
    shutil.rmtree(sample.place)


@SEVERAL
@given(at=places)
def test_a_log_that_was_cut_off_is_counted_as_lost(
    killed: Sample, tmp_path_factory: pytest.TempPathFactory, at: float
) -> None:
    sample = killed.copy(tmp_path_factory.mktemp('cut'))
    file = beside(sample.place, '-wal')
    os.truncate(file, int(at * file.stat().st_size))
    assert sample.check() <= 100
    shutil.rmtree(sample.place)


def test_without_its_log_the_rows_in_it_are_counted_as_lost(killed: Sample, place: Path) -> None:
    sample = killed.copy(place)
    beside(place, '-wal').unlink()
    assert sample.check() == 100


def test_a_killed_process_costs_nothing(killed: Sample, place: Path) -> None:
    assert killed.copy(place).check() == 0
    assert put_aside(place) == []


def test_the_other_files_beside_it_are_not_needed(killed: Sample, place: Path) -> None:
    sample = killed.copy(place)
    beside(place, '-shm').unlink()
    beside(place, '.lock').unlink()
    assert sample.check() == 0


@SEVERAL
@given(at=places, pages=st.integers(1, 4), log=st.booleans())
def test_what_pages_of_zeros_cost_is_counted(
    killed: Sample, tmp_path_factory: pytest.TempPathFactory, at: float, pages: int, *, log: bool
) -> None:
    sample = killed.copy(tmp_path_factory.mktemp('zeros'))
    file = beside(sample.place, '-wal' if log else '')
    size = file.stat().st_size
    first = int(at * size) // database.PAGE_BYTES * database.PAGE_BYTES
    overwrite(file, first, bytes(min(size - first, pages * database.PAGE_BYTES)))
    sample.check()
    shutil.rmtree(sample.place)


def test_a_damaged_page_costs_the_rows_in_it(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    zero_page(beside(place), b'300 300 ')
    assert 1 <= sample.check() <= 25, 'a page of small rows holds some twenty'


def test_what_is_between_two_damaged_pages_is_read(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    for text in (b'250 250 ', b'450 450 '):
        zero_page(beside(place), text)
    assert 2 <= sample.check() <= 50
    assert set(range(300, 401)) <= set(numbers(reopened(place).rows))


def test_without_any_ledger_the_gaps_are_counted(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    beside(place, '.lock').unlink()
    content = beside(place).read_bytes().replace(b'RKBSPOOL', b'________')
    broken = content.index(b'300 300 ')
    beside(place).write_bytes(content[:broken] + b'#' + content[broken + 1 :])
    found = reopened(place)
    assert not found.certain
    assert set(numbers(found.rows)) >= set(sample.rows) - {300}
    assert 300 not in numbers(found.rows)


def test_a_file_that_is_gone_is_counted_as_lost(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    beside(place).unlink()
    assert sample.check() == len(sample.rows)


def test_an_empty_file_without_a_past_becomes_a_spool(place: Path) -> None:
    beside(place).touch()
    with opened(place) as spool:
        assert spool.damage is None
        spool.append(rows(1, 3))
    assert numbers(reopened(place).rows) == [1, 2, 3]


def test_bytes_behind_the_last_page_do_no_harm(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    with beside(place).open('ab') as file:
        file.write(b'\xff' * 1000)
    assert sample.check() == 0


def test_the_damaged_file_is_put_aside_and_the_loss_is_said(
    closed: Sample, place: Path, caplog: pytest.LogCaptureFixture
) -> None:
    closed.copy(place)
    content = bytearray(beside(place).read_bytes())
    content[content.index(b'300 300 ')] ^= 255
    beside(place).write_bytes(content)
    with caplog.at_level(logging.ERROR), opened(place) as spool:
        kept = put_aside(place)
        assert len(kept) == 1
        assert kept[0].read_bytes() == content
        assert kept[0].stat().st_mode & 0o777 == 0o600
        assert spool.damage == repair.Damage(1, certain=True, kept_as=kept[0])
        assert spool.take_lost() == 1
        assert spool.take_lost() == 0
    assert len(caplog.records) == 1
    said = caplog.records[0].getMessage()
    assert f'the spool {beside(place)} is damaged (row 300 is not as it was written)' in said
    assert f'{len(closed.rows) - 1} messages in it can be read, 1 message lost' in said
    assert f'the damaged file is kept as {kept[0]}' in said


def test_rows_that_were_released_or_dropped_never_come_back(closed: Sample, place: Path) -> None:
    sample = closed.copy(place)
    with opened(place) as spool:
        spool.delete_before(200)
        spool.drop_oldest(250, 5000)
        left = numbers(read_all(spool))
    content = bytearray(beside(place).read_bytes())
    content[32:40] = bytes(8)  # which pages are free is not known any more
    content[content.index(b'500 500 ')] ^= 255
    beside(place).write_bytes(content)
    assert numbers(reopened(place).rows) == [number for number in left if number != 500]
    assert len(left) < len(sample.rows)


@pytest.mark.parametrize('stage', ['written', 'named', 'log put aside', 'put aside'])
def test_a_repair_that_was_interrupted_is_taken_up_again(
    killed: Sample, place: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    sample = killed.copy(place)
    content = bytearray(beside(place).read_bytes())
    content[16:18] = b'\0\0'
    beside(place).write_bytes(content)

    class Interrupted(BaseException):
        pass

    def interrupt(*_: object, **__: object) -> None:
        raise Interrupted

    target, name = {
        'written': (Path, 'rename'),
        'named': (repair, '_finish'),
        'log put aside': (os, 'link'),
        'put aside': (Path, 'replace'),
    }[stage]
    with monkeypatch.context() as patched:
        original = getattr(target, name)
        calls: list[object] = []

        def at_the_second(*given: object, **more: object) -> object:
            calls.append(given)
            # The first call of _finish is the one that looks for an interrupted repair.
            if name != '_finish' or len(calls) > 1:
                interrupt()
            return original(*given, **more)

        patched.setattr(target, name, at_the_second)
        with pytest.raises(Interrupted):
            make(place).open()
    found = reopened(place)
    assert numbers(found.rows) == sorted(sample.rows)
    assert [file.name for file in place.iterdir() if file.suffix in {'.new', '.salvage'}] == []
    assert len([file for file in put_aside(place) if not file.name.endswith('-wal')]) == 1


def test_a_damaged_file_of_an_unknown_version_is_not_taken_for_a_newer_one(
    closed: Sample, place: Path
) -> None:
    sample = closed.copy(place)
    content = bytearray(beside(place).read_bytes())
    content[63] = 77
    beside(place).write_bytes(content)
    assert sample.check() == 0
