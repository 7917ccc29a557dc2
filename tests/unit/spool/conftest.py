"""What the tests of spools share, and those of a pipeline with one."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.spools.files import Sample, fill, opened, read_all, rows
from support.worlds.pipeline_with_spool import House, Make


@pytest.fixture
def house(tmp_path: Path) -> Iterator[Make]:
    """Makes lives, all with the same spool; none is left open for the garbage collector."""
    made: list[House] = []

    def make(spool: dict[str, Any] | None = None, **more: Any) -> House:
        made.append(House(tmp_path, spool, **more))
        return made[-1]

    yield make
    for one in made:
        if one.spool.is_open:
            one.crash()


@pytest.fixture(scope='module')
def closed(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    """A spool that was closed in order."""
    place = tmp_path_factory.mktemp('closed')
    return Sample(place, fill(place))


@pytest.fixture(scope='module')
def killed(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    """A spool whose process was killed: the last transactions are in the log only."""
    source = tmp_path_factory.mktemp('source')
    place = tmp_path_factory.mktemp('killed')
    fill(source)
    with opened(source) as spool:
        for first in range(601, 701, 10):
            spool.append(rows(first, first + 9))
        spool.delete_before(40)
        held = {one.number: one for one in read_all(spool)}
        for file in source.iterdir():
            shutil.copy(file, place)
    return Sample(place, held)


@pytest.fixture
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    place = tmp_path_factory.mktemp('spool')
    yield place
    shutil.rmtree(place)
