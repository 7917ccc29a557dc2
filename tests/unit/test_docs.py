"""The pages that are made of the settings are today's; the tests that pages name are there."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_and_the_schema_are_up_to_date() -> None:
    result = subprocess.run(
        [sys.executable, ROOT / 'tools' / 'make_docs.py', '--check'],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def named() -> Iterator[tuple[str, str, str]]:
    """Each test that a page names: the page, the file, the beginning of its name (or nothing)."""
    alone = (ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'SECURITY.md'))
    for page in (*alone, *(ROOT / 'docs').glob('*.md')):
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
