"""Pages are today's, short, and lead somewhere; tests and commands that they name are there."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from support.install.checkout import ROOT, fenced, links, pages, sections
from support.processes.terminal import finished

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.outside.extras import PUBLISHED


def test_the_page_and_the_schema_are_up_to_date() -> None:
    result = finished([sys.executable, ROOT / 'tools' / 'make_docs.py', '--check'])
    assert result.returncode == 0, result.stdout + result.stderr


def named() -> Iterator[tuple[str, str, str]]:
    """Each test that a page names: the page, the file, the beginning of its name (or nothing)."""
    for page in pages():
        file = ''
        for path, name in re.findall(r'(tests/[\w/]+\.py)|`(test_\w+)`', page.read_text()):
            file = path or file
            if path or file:
                yield page.name, file, name


def test_the_tests_that_the_pages_name_are_there() -> None:
    found = set(named())
    assert len(found) > 50
    texts = {file: (ROOT / file).read_text() for _, file, _ in found if (ROOT / file).exists()}
    missing = [
        one
        for one in found
        if one[1] not in texts or (one[2] and f'def {one[2]}(' not in texts[one[1]])
    ]
    assert missing == []


def test_the_gate_has_a_test_of_each_guarantee_that_names_it() -> None:
    names = ' '.join(
        name
        for file in (ROOT / 'tests' / 'integration').glob('*.py')
        for name in re.findall(r'def (test_\w*guarantees?_\w+)', file.read_text())
    )
    proven = {int(number) for number in re.findall(r'(?<=_)[1-8](?=_|\b)', names)}
    assert proven == set(range(1, 9))


def test_the_readme_is_short() -> None:
    assert len((ROOT / 'README.md').read_text().split()) <= 1200


def test_the_ten_lines_of_the_readme_are_those_of_the_example() -> None:
    [shown] = fenced('README.md', 'yaml')
    lines = [re.sub(r' +# .*', '', line) for line in shown.splitlines()]
    assert lines == (ROOT / 'examples' / 'bridge.yaml').read_text().splitlines()
    assert len(lines) == 10


def test_the_example_of_the_configuration_page_is_right() -> None:
    example, *_ = fenced('docs/configuration.md', 'yaml')
    assert loads(example, 'bridge.yaml', {}).name == 'warehouse-1'


@pytest.mark.parametrize('page', list(pages()), ids=lambda page: page.name)
def test_what_a_page_links_to_is_there(page: Path) -> None:
    for link in links(page):
        assert link.target.exists(), link
        if link.section:
            assert link.section in sections(link.target), link


def test_every_page_is_reached_from_the_readme() -> None:
    reached, ahead = set(), [ROOT / 'README.md']
    while ahead:
        page = ahead.pop()
        reached.add(page)
        ahead += {link.target for link in links(page) if link.target.suffix == '.md'} - reached
    assert set(pages()) - reached == set()


def test_every_command_is_on_the_page_of_commands() -> None:
    told = re.findall(r'`ros2-kafka-bridge ([a-z-]+)', (ROOT / 'docs' / 'commands.md').read_text())
    command = typer.main.get_command(app)
    assert set(told) == set(getattr(command, 'commands', {}))


def test_nobody_is_told_to_install_by_a_name_that_may_be_anybodys() -> None:
    """Until a release has registered it: `make version` switches `PUBLISHED` and the pages."""
    name = r'pip install [^`\n]*ros2-kafka-bridge(?=[\[\s`\'"]|$)'
    code = [*ROOT.glob('src/**/*.py'), *ROOT.glob('examples/**/*.py')]
    told = {
        str(file.relative_to(ROOT)): line
        for file in (*pages(), *code)
        for line in file.read_text().splitlines()
        if re.search(name, line) and '--no-index' not in line
    }
    assert PUBLISHED or told == {}
