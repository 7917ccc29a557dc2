"""The pages that people read: the README, what lies beside it, and docs; and as a site."""

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from command_line import finished

if TYPE_CHECKING:
    from harness import Bench

ROOT: Final = Path(__file__).parents[1]
_ALONE: Final = ('README.md', 'CONTRIBUTING.md', 'SECURITY.md', 'CHANGELOG.md')


def pages() -> Iterator[Path]:
    """All of them."""
    yield from (ROOT / name for name in _ALONE)
    yield from sorted((ROOT / 'docs').glob('*.md'))


def fenced(page: str, language: str) -> list[str]:
    """The blocks of a page that are of a language (or of none), in their order."""
    text = (ROOT / page).read_text()
    blocks = re.findall(r'^```(\w*)\n(.*?)^```$', text, re.DOTALL | re.MULTILINE)
    return [block for name, block in blocks if name == language]


class Link(NamedTuple):
    """A link from one page to a file of the repository.

    Args:
        page: On which it stands.
        target: Where it leads.
        section: The anchor there; empty for the whole.
    """

    page: Path
    target: Path
    section: str


def links(page: Path) -> Iterator[Link]:
    """What a page links to in the repository."""
    text = _without_code(page.read_text())
    for target, section in re.findall(r'\]\((?![a-z]+:)([^)#\s]*)#?([^)\s]*)\)', text):
        yield Link(page, (page.parent / target).resolve() if target else page, section)


def sections(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    found: set[str] = set()
    for heading in re.findall(r'^#+ +(.*)$', _without_code(page.read_text()), re.MULTILINE):
        name = base = re.sub(r'[^\w\- ]', '', heading.strip().lower()).replace(' ', '-')
        number = 0
        while name in found:
            number += 1
            name = f'{base}-{number}'
        found.add(name)
    return found


def build_site(folder: Path) -> None:
    """Build the site as `make site` does, elsewhere."""
    result = finished(
        [Path(sys.executable).with_name('mkdocs'), 'build', '--strict', '--site-dir', folder],
        cwd=ROOT,
        env={**os.environ, 'NO_MKDOCS_2_WARNING': '1'},
    )
    assert result.returncode == 0, result.stderr


def _without_code(text: str) -> str:
    return re.sub(r'^```.*?^```$', '', text, flags=re.DOTALL | re.MULTILINE)


def example(bench: 'Bench', name: str) -> Path:
    """A copy of an example that knows the broker of the test."""
    text = (ROOT / 'examples' / f'{name}.yaml').read_text()
    file = bench.place / f'{name}.yaml'
    file.write_text(text.replace('localhost:9092', bench.bootstrap_servers))
    return file
