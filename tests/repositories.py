"""Repositories of git that tests make: of a few files, or of all that this checkout has."""

import shutil
import subprocess
from pathlib import Path

from pages import ROOT


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
