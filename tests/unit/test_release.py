"""What has to be there before a release is made, in a checkout of its own."""

import re
import shutil
from collections.abc import Iterator
from datetime import date
from pathlib import Path

import pytest
from releasing import CHANGELOG, CLOCK, FACE, WHEN_PUBLISHED, NotReadyError, cut, main, problems
from support.install.checkout import commit, git, make_repository

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.outside.extras import PUBLISHED

ROOT = Path(__file__).parents[2]
DAY = date(2026, 12, 24)
DATED = r'## \[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d'
TAG = f'v{__version__}'
PARTS = (CHANGELOG, CLOCK, FACE, *WHEN_PUBLISHED, 'SECURITY.md', 'package.xml', 'pyproject.toml')
NOTED = '# Changelog\n\n## [Unreleased]\n\n- More.\n'
PLACEHOLDERS = re.compile(r'.*(?:EXAMPLE\.INVALID|placeholder:).*')


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The files that a release looks at, committed, and a change that was noted.

    Its changelog is its own: that of this project is cut at one time, and noted in at another.
    """
    for part in PARTS:
        (tmp_path / part).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / part, tmp_path / part)
    (tmp_path / CHANGELOG).write_text(NOTED)
    make_repository(tmp_path)
    return tmp_path


def fill_in(place: Path) -> None:
    for part in PARTS:
        text = (place / part).read_text()
        (place / part).write_text(PLACEHOLDERS.sub('filled in', text))


@pytest.fixture
def ready(checkout: Path) -> Path:
    """One that can be released."""
    fill_in(checkout)
    cut(checkout, __version__, DAY)
    commit(checkout)
    git(checkout, 'tag', TAG)
    return checkout


def headings(place: Path) -> list[str]:
    return re.findall(r'^## .*', (place / CHANGELOG).read_text(), re.MULTILINE)


def places(found: Iterator[str]) -> set[str]:
    return {line.split(': ')[0] for line in found}


def test_a_checkout_that_says_the_version_and_has_its_tag_can_be_released(ready: Path) -> None:
    assert list(problems(ready)) == []


def test_every_placeholder_is_refused_with_its_line(checkout: Path) -> None:
    wanted = {
        f'{part}:{number}'
        for part in PARTS
        for number, line in enumerate((checkout / part).read_text().splitlines(), 1)
        if PLACEHOLDERS.match(line)
    }
    assert wanted == {place for place in places(problems(checkout)) if ':' in place}


@pytest.mark.parametrize(
    'top',
    ['## [Unreleased]', f'## [{__version__}] - not yet released', '## [9.9.9] - 2026-12-24'],
)
def test_a_changelog_without_the_day_of_the_version_is_refused_with_what_writes_it(
    top: str, ready: Path
) -> None:
    text = (ready / CHANGELOG).read_text()
    (ready / CHANGELOG).write_text(text.replace(headings(ready)[0], top))
    commit(ready)
    [told] = problems(ready)
    assert told.startswith(f'{CHANGELOG}: ')
    assert f'{__version__} is out; make version V=...' in told
    git(ready, 'tag', '--delete', TAG)
    [told] = problems(ready)
    assert f': make version V={__version__}' in told


def test_a_file_that_does_not_say_that_it_is_published_is_refused(ready: Path) -> None:
    for name, (before, after) in WHEN_PUBLISHED.items():
        text = (ready / name).read_text()
        (ready / name).write_text(text.replace(after, before))
    assert {*WHEN_PUBLISHED} <= places(problems(ready))


def test_a_commit_without_its_tag_is_refused_and_the_tag_that_is_elsewhere_named(
    ready: Path,
) -> None:
    git(ready, 'tag', '--delete', TAG)
    [told] = problems(ready)
    assert f'git tag --sign {TAG}' in told
    git(ready, 'tag', TAG)
    (ready / 'more').touch()
    commit(ready)
    [told] = problems(ready)
    assert f'git checkout {TAG}' in told


def test_what_is_not_committed_is_refused_and_named(ready: Path) -> None:
    (ready / 'SECURITY.md').write_text('changed')
    (ready / 'new').touch()
    assert list(problems(ready)) == ['not committed: SECURITY.md, new']


def test_what_git_itself_refuses_is_told_and_not_taken_for_nothing(
    ready: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (ready / '.git' / 'HEAD').unlink()
    monkeypatch.setenv('GIT_CEILING_DIRECTORIES', str(ready.parent))
    with pytest.raises(NotReadyError, match='not a git repository'):
        list(problems(ready))


def test_a_program_that_is_missing_is_named(ready: Path) -> None:
    assert list(problems(ready, 'git', 'no-such-program')) == [
        'the program no-such-program is not here'
    ]


def test_a_cut_dates_what_was_noted_and_writes_the_version_and_that_it_is_published(
    checkout: Path,
) -> None:
    cut(checkout, '7.0.1', DAY)
    cut_one = NOTED.replace('[Unreleased]', '[7.0.1] - 2026-12-24')
    assert (checkout / CHANGELOG).read_text() == cut_one
    assert "__version__ = '7.0.1'\n" in (checkout / FACE).read_text()
    assert 'datetime(2026, 12, 24, tzinfo=UTC)' in (checkout / CLOCK).read_text()
    for name, (before, after) in WHEN_PUBLISHED.items():
        assert after in (checkout / name).read_text()
        assert before not in (checkout / name).read_text()


def test_cut_again_it_has_the_new_day_and_nothing_else_changes(ready: Path) -> None:
    git(ready, 'tag', '--delete', TAG)
    cut(ready, __version__, date(2026, 12, 31))
    changed = git(ready, 'diff', '--unified=0')
    assert [
        line for line in changed.splitlines() if line.startswith('+') and '+++' not in line
    ] == [
        f'+## [{__version__}] - 2026-12-31',
        '+RELEASED: Final = datetime(2026, 12, 31, tzinfo=UTC)',
    ]


@pytest.mark.parametrize(
    ('version', 'why'),
    [
        ('1.0', 'three numbers'),
        ('v1.0.0', 'three numbers'),
        ('', 'three numbers'),
        ('0.02.0', 'three numbers'),
        ('9.9.9', rf'the section on top is that of {re.escape(__version__)}: note what is new'),
        (__version__, f'{__version__} is out'),
    ],
)
def test_what_is_no_next_version_is_refused_and_nothing_written(
    version: str, why: str, ready: Path
) -> None:
    with pytest.raises(NotReadyError, match=why):
        cut(ready, version, DAY)
    assert list(problems(ready)) == []


def test_a_version_that_is_not_later_than_the_last_is_refused(ready: Path) -> None:
    for version in ('97.9.0', '97.10.0'):
        note_more(ready)
        cut(ready, version, DAY)
    assert headings(ready)[:2] == ['## [97.10.0] - 2026-12-24', '## [97.9.0] - 2026-12-24']
    note_more(ready)
    for version in (__version__, '97.9.1', '97.10.0'):
        with pytest.raises(NotReadyError, match=f'{version} is not later than 97.10.0'):
            cut(ready, version, DAY)


def test_a_first_version_that_is_not_that_of_the_code_or_later_is_refused(checkout: Path) -> None:
    with pytest.raises(NotReadyError, match=f'0.0.9 is not later than {__version__}'):
        cut(checkout, '0.0.9', DAY)


def test_a_version_for_which_nothing_is_noted_is_refused(ready: Path) -> None:
    text = (ready / CHANGELOG).read_text()
    first = headings(ready)[0]
    (ready / CHANGELOG).write_text(text.replace(first, f'## [Unreleased]\n\n{first}'))
    with pytest.raises(NotReadyError, match='nothing is noted'):
        cut(ready, '99.0.0', DAY)


def test_a_file_in_other_words_is_named_before_anything_is_written(ready: Path) -> None:
    note_more(ready)
    _, after = WHEN_PUBLISHED['README.md']
    text = (ready / 'README.md').read_text()
    (ready / 'README.md').write_text(text.replace(after, 'or from elsewhere.'))
    commit(ready)
    with pytest.raises(NotReadyError, match=r'README\.md: it says neither'):
        cut(ready, '99.0.0', DAY)
    assert git(ready, 'status', '--porcelain') == ''


def test_without_git_that_is_all_that_is_told(ready: Path) -> None:
    shutil.rmtree(ready / '.git')
    [told] = problems(ready)
    assert 'no checkout of git' in told


def test_the_tag_is_asked_for_once_nothing_else_is_to_be_changed(ready: Path) -> None:
    git(ready, 'tag', '--delete', TAG)
    (ready / 'new').touch()
    [told] = problems(ready)
    assert 'not committed' in told


def note_more(place: Path) -> None:
    text = (place / CHANGELOG).read_text()
    first = headings(place)[0]
    (place / CHANGELOG).write_text(text.replace(first, f'## [Unreleased]\n\n- More.\n\n{first}'))


def test_the_changelog_of_this_project_can_be_cut_next(checkout: Path) -> None:
    """Below the section on top, which may be without a day, each has its version and its day."""
    shutil.copy(ROOT / CHANGELOG, checkout)
    top, *released = headings(checkout)
    assert [line for line in released if not re.fullmatch(DATED, line)] == []
    (checkout / CHANGELOG).write_text(
        (checkout / CHANGELOG).read_text().replace(top, '## [Unreleased]', 1)
    )
    cut(checkout, '99.0.0', DAY)
    assert headings(checkout) == ['## [99.0.0] - 2026-12-24', *released]


def test_until_then_every_file_says_that_it_is_not_published() -> None:
    for name, texts in WHEN_PUBLISHED.items():
        said = [text in (ROOT / name).read_text() for text in texts]
        assert said == [not PUBLISHED, PUBLISHED], name


def test_whoever_asks_is_told_every_reason_and_no_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.argv', ['releasing.py', 'no-such-program'])
    assert main() == 2
    told = capsys.readouterr().err.splitlines()
    assert 'the program no-such-program is not here' in told


def test_a_cut_without_a_version_is_refused_and_not_taken_for_a_question(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.argv', ['releasing.py', '--cut', ''])
    assert main() == 2
    assert capsys.readouterr().err == "'' is no version: V takes three numbers, such as 0.2.0\n"
