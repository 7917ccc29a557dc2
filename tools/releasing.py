"""What a release needs: `make version V=0.2.0` writes it, `make release` looks for it.

What a release is made of stands in the Makefile, who publishes it in CONTRIBUTING.md.
"""

import argparse
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Final

from packaging.version import Version

ROOT: Final = Path(__file__).parents[1]
FACE: Final = 'src/ros2_kafka_bridge/__init__.py'
CLOCK: Final = 'src/ros2_kafka_bridge/route/clock.py'
CHANGELOG: Final = 'CHANGELOG.md'

PLACEHOLDERS: Final = ('EXAMPLE.INVALID', 'placeholder:')
"""How a line says that it holds no name or address yet."""

WHEN_PUBLISHED: Final = {
    'src/ros2_kafka_bridge/outside/extras.py': (
        'PUBLISHED: Final = False',
        'PUBLISHED: Final = True',
    ),
    'README.md': (
        'It is not on PyPI yet: install from a checkout.',
        "From PyPI: `pip install 'ros2-kafka-bridge[ros]'`; or from a checkout, as here.",
    ),
    'docs/install.md': (
        '**It is not on PyPI yet**, and somebody else may register the name: ',
        '**From PyPI**: `pip install ros2-kafka-bridge`, with `[ros]` for ROS 2 as wheels. Or ',
    ),
}
"""What a file says until the name is registered, and then."""

_HEADING: Final = re.compile(r'^## \[(.+?)\](?: - (.*))?$', re.MULTILINE)
_VERSION: Final = re.compile(r'(?:0|[1-9]\d*)(?:\.(?:0|[1-9]\d*)){2}')
_DAY: Final = re.compile(r'\d{4}-\d\d-\d\d')
_FILES_TOLD: Final = 5


class NotReadyError(Exception):
    """There can be no such release, and why not."""


def cut(root: Path, version: str, today: date) -> None:
    """Make the files of a checkout say that this version is out, from that day on.

    Args:
        root: The checkout.
        version: Three numbers, such as 0.2.0.
        today: In UTC.

    Raises:
        NotReadyError: The version is none, is out, or not later than the last, or nothing is
            noted for it; or a file says otherwise than it should.
    """
    noted = _noted(root, version)
    if _git(root, 'tag', '--list', f'v{version}'):
        raise NotReadyError(f'{version} is out: v{version} is there')
    switched = {
        root / name: _switched(root / name, *said) for name, said in WHEN_PUBLISHED.items()
    }
    _replace(root / CHANGELOG, re.escape(noted[0]), f'## [{version}] - {today}')
    _replace(root / FACE, r"__version__ = '.*'", f"__version__ = '{version}'")
    made = f'datetime({today.year}, {today.month}, {today.day}, tzinfo=UTC)'
    _replace(root / CLOCK, r'datetime\(\d+, \d+, \d+, tzinfo=UTC\)', made)
    for file, text in switched.items():
        file.write_text(text, 'utf-8')


def problems(root: Path, *programs: str) -> Iterator[str]:
    """What keeps a checkout from being released, with the cure.

    Args:
        root: The checkout.
        programs: What it takes to make the files.
    """
    if not (root / '.git').exists():
        yield f'{root} is no checkout of git: a release is made of a tag'
        return
    version = _version(root)
    found = [*_uncommitted(root), *_placeholders(root), *_not_cut(root, version)]
    # The tag comes last: it stays with the commit that it was given to.
    yield from found or _not_tagged(root, f'v{version}')
    for program in programs:
        if shutil.which(program) is None:
            yield f'the program {program} is not here'


def _noted(root: Path, version: str) -> re.Match[str]:
    """The heading under which the changes of that version are noted: that on top."""
    if not _VERSION.fullmatch(version):
        raise NotReadyError(f'{version!r} is no version: V takes three numbers, such as 0.2.0')
    text = (root / CHANGELOG).read_text('utf-8')
    top, *earlier = _HEADING.finditer(text)
    if top[1] != version and _DAY.fullmatch(top[2] or ''):
        raise NotReadyError(
            f'{CHANGELOG}: the section on top is that of {top[1]}: note what is new above it, '
            f'under `## [Unreleased]`; or, where it is not out, take it back (git restore)'
        )
    if not text[top.end() : earlier[0].start() if earlier else None].strip():
        raise NotReadyError(f'{CHANGELOG}: nothing is noted below {top[0]}')
    latest = earlier[0][1] if earlier else _version(root)
    if Version(version) < Version(latest) or (earlier and version == latest):
        raise NotReadyError(f'{version} is not later than {latest}')
    return top


def _switched(file: Path, before: str, after: str) -> str:
    text = file.read_text('utf-8')
    if before not in text and after not in text:
        raise NotReadyError(f'{file}: it says neither {before!r} nor {after!r}')
    return text.replace(before, after)


def _version(root: Path) -> str:
    [found] = re.findall(r"^__version__ = '(.*)'$", (root / FACE).read_text('utf-8'), re.MULTILINE)
    return str(found)


def _replace(file: Path, old: str, new: str) -> None:
    text, count = re.subn(old, lambda _: new, file.read_text('utf-8'), count=1)
    if not count:
        raise NotReadyError(f'{file.name}: {old} is not in it')
    file.write_text(text, 'utf-8')


def _uncommitted(root: Path) -> Iterator[str]:
    if changed := _git(root, 'status', '--porcelain'):
        told = ', '.join(line[3:] for line in changed[:_FILES_TOLD])
        more = f' and {len(changed) - _FILES_TOLD} more' if len(changed) > _FILES_TOLD else ''
        yield f'not committed: {told}{more}'


def _not_cut(root: Path, version: str) -> Iterator[str]:
    is_out = _git(root, 'tag', '--list', f'v{version}')
    wanted = f'{version} is out; make version V=...' if is_out else f'make version V={version}'
    cure = f'{wanted}, and land what it writes'
    top = _HEADING.search((root / CHANGELOG).read_text('utf-8'))
    if top is None or top[1] != version or not _DAY.fullmatch(top[2] or ''):
        yield f'{CHANGELOG}: the section on top is not that of {version} with its day: {cure}'
    for name, (_, after) in WHEN_PUBLISHED.items():
        if after not in (root / name).read_text('utf-8'):
            yield f'{name}: it does not say {after!r}: {cure}'


def _not_tagged(root: Path, tag: str) -> Iterator[str]:
    if tag not in _git(root, 'tag', '--points-at', 'HEAD'):
        is_elsewhere = _git(root, 'tag', '--list', tag)
        made = f'git tag --sign {tag}, once the gate is green'
        yield f'this commit is not {tag}: {f"git checkout {tag}" if is_elsewhere else made}'


def _placeholders(root: Path) -> Iterator[str]:
    patterns = [word for mark in PLACEHOLDERS for word in ('-e', mark)]
    elsewhere = (':!tests', ':!tools/releasing.py')
    found = _git(root, 'grep', '-niIF', *patterns, '--', '.', *elsewhere)
    for line in found:
        file, number, text = line.split(':', 2)
        yield f'{file}:{number}: a placeholder, for whoever publishes to fill in: {text.strip()}'


def _git(root: Path, *words: str) -> list[str]:
    done = subprocess.run(  # noqa: S603
        ['git', *words],  # noqa: S607
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode > 1:  # 1: grep has found nothing
        raise NotReadyError(done.stderr.strip())
    return done.stdout.splitlines()


def main() -> int:
    """Cut a version, or say what keeps this one from being released."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--cut', metavar='VERSION', help='make the files say this version')
    parser.add_argument('programs', nargs='*', help='that have to be here')
    asked = parser.parse_args()
    try:
        if asked.cut is None:
            found = list(problems(ROOT, *asked.programs))
        else:  # '' is what `make version` without V gives
            cut(ROOT, asked.cut, datetime.now(UTC).date())
            found = []
    except NotReadyError as error:
        found = [str(error)]
    for problem in found:
        print(problem, file=sys.stderr)
    return 2 if found else 0


if __name__ == '__main__':
    sys.exit(main())
