"""A spool that an earlier version of the bridge has left holds for this one what it held."""

from pathlib import Path

import pytest
from support.spools.files import STATES, VERSIONS, held, opened, put, read_all, reopened, row

from ros2_kafka_bridge.spool.ledger import VERSION
from ros2_kafka_bridge.spool.look import look
from ros2_kafka_bridge.spool.store import file_of

every_spool = pytest.mark.parametrize(
    ('version', 'state'), [(version, state) for version in VERSIONS for state in STATES]
)


def test_every_version_that_there_was_has_its_files() -> None:
    assert tuple(range(1, VERSION + 1)) == VERSIONS, 'tests/earlier_spools.py tells of them'


@every_spool
def test_every_row_is_read_as_it_was_written(tmp_path: Path, version: int, state: str) -> None:
    put(version, state, file_of(tmp_path, 'bridge', 'route'))
    found = reopened(tmp_path)
    assert found.rows == held(state)
    assert (found.lost, found.certain) == (0, True)


@every_spool
def test_it_is_taken_for_well_and_goes_on(tmp_path: Path, version: int, state: str) -> None:
    put(version, state, file_of(tmp_path, 'bridge', 'route'))
    rows = held(state)
    with opened(tmp_path) as spool:
        assert spool.damage is None
        spool.delete_before(rows[3].number)
        new = row(rows[-1].number + 1)
        assert spool.append([new]) == new.number
        assert read_all(spool) == [*rows[3:], new]
    assert reopened(tmp_path).rows == [*rows[3:], new]


@every_spool
def test_a_look_shows_it_and_changes_nothing(tmp_path: Path, version: int, state: str) -> None:
    file = file_of(tmp_path, 'bridge', 'route')
    put(version, state, file)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    seen = look(file, messages=100)
    assert (seen.version, seen.damage, seen.problem, seen.lost) == (version, '', '', 0)
    assert seen.rows == held(state)
    assert (seen.ros_topic, seen.kafka_topic, seen.dead_letters) == ('/orders', 'orders', 1)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
