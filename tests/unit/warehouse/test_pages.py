"""The commands on the pages of the warehouse: the program has them, with their options."""

import re
import shlex
from collections.abc import Iterator
from typing import Final

import pytest
from support.install.checkout import ROOT, fenced
from typer.testing import CliRunner

from ros2_kafka_warehouse.cli import app

PAGES: Final = ('docs/warehouse.md', 'docs/warehouse-extend.md', 'docs/warehouse-modules.md')
WAREHOUSE: Final = '.venv/bin/ros2-kafka-warehouse'


def lines() -> Iterator[str]:
    for page in PAGES:
        for block in fenced(page, 'sh'):
            yield from block.splitlines()


def arguments(line: str) -> list[str]:
    """What the warehouse gets of a line; nothing where that runs something else."""
    match shlex.split(line):
        case ['make', 'warehouse', *variables]:
            return ['run', *' '.join(variables).removeprefix('A=').split()]
        case [command, *words] if command == WAREHOUSE:
            return words
    return []


def is_understood(*words: str) -> bool:
    """Whether there is such a command, with such options; it is not run."""
    result = CliRunner().invoke(app, [*words, '--help'])
    return result.exit_code == 0 and 'Usage:' in result.output


@pytest.mark.parametrize('line', [line for line in lines() if arguments(line)])
def test_a_command_of_a_page_is_understood(line: str) -> None:
    assert is_understood(*arguments(line))


def test_a_file_that_a_command_of_a_page_names_is_there() -> None:
    words = {word for line in lines() for word in line.split()}
    named = {word for word in words if re.match('(examples|src)/', word)}
    assert len(named) == 4
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_a_command_that_a_sentence_names_is_there() -> None:
    text = ''.join((ROOT / page).read_text() for page in PAGES)
    named = set(re.findall(r'`ros2-kafka-warehouse ([a-z-]+)', text))
    assert len(named) > 4
    assert [name for name in named if not is_understood(name)] == []
