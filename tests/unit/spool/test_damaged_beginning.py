"""A spool whose first pages are damaged, which lead to all others."""

from pathlib import Path

import pytest
from damaged_spools import Sample, beside, flip, overwrite
from spools import make, reopened

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.spool import database


@pytest.mark.parametrize(('page', 'is_lost'), [(1, True), (2, False), (3, True)])
def test_all_is_lost_and_counted_without_the_page_that_leads_to_all_rows(
    closed: Sample, place: Path, page: int, *, is_lost: bool
) -> None:
    sample = closed.copy(place)
    overwrite(beside(place), (page - 1) * database.PAGE_BYTES, bytes(database.PAGE_BYTES))
    assert sample.check() == is_lost * len(sample.rows)


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
