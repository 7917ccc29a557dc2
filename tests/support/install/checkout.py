"""What this checkout has: the pages that people read, its files as a repository, its examples."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from support.processes.terminal import finished

if TYPE_CHECKING:
    from support.processes.harness import Bench

ROOT: Final = Path(__file__).parents[3]
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


def git(place: Path, *words: str) -> str:
    """Run git there to a good end; returns what it prints."""
    told = subprocess.run(['git', *words], cwd=place, capture_output=True, text=True, check=True)
    return told.stdout


def commit(place: Path) -> None:
    """Commit all that is there."""
    git(place, 'add', '--all')
    git(place, 'commit', '--quiet', '--message', 'a change')


def make_repository(place: Path) -> None:
    """Make one of a folder, and commit what is in it, whoever the user of this machine is."""
    for words in ('init --quiet', 'config user.name A', 'config user.email a@b.example',
                  'config commit.gpgsign false', 'config tag.gpgsign false'):  # fmt: skip
        git(place, *words.split())
    commit(place)


def copy_checkout(place: Path) -> None:
    """Make one of the files of this checkout as they are now."""
    for name in git(ROOT, 'ls-files', '--cached', '--others', '--exclude-standard').splitlines():
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    make_repository(place)


def renamed(file: Path, *names: tuple[str, str]) -> Path:
    """The file with other names in its values."""
    text = file.read_text()
    for old, new in names:
        assert re.search(rf'(?<=: ){re.escape(old)}(?=[,}}\n])', text), old
        text = re.sub(rf'(?<=: ){re.escape(old)}(?=[,}}\n])', new, text)
    file.write_text(text)
    return file
