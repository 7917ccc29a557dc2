""".github/workflows: what they run is here, they may do little, and publish what was tested."""

import os
import re
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML
from support.install.checkout import ROOT

FILES: Final = sorted((ROOT / '.github' / 'workflows').glob('*.yml'))
WORKFLOWS: Final[dict[str, Any]] = {file.stem: YAML(typ='safe').load(file) for file in FILES}
RELEASE: Final[dict[str, Any]] = WORKFLOWS['release']['jobs']
MAKEFILE: Final = (ROOT / 'Makefile').read_text()
PINNED: Final = re.compile(r'[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+')
OWN: Final = './.github/workflows/'


def jobs() -> Iterator[tuple[str, Any]]:
    for workflow, content in WORKFLOWS.items():
        for name, job in content['jobs'].items():
            yield f'{workflow}.{name}', job


def commands() -> Iterator[str]:
    for _, job in jobs():
        yield from (step['run'] for step in job.get('steps', []) if 'run' in step)
    yield from (file.read_text() for file in (ROOT / '.ci').iterdir())


def uses(job: Any) -> Iterator[Any]:
    yield from (step for step in job['steps'] if 'uses' in step)


def awaited(name: str) -> set[str]:
    """The jobs of a release that have ended well before this one begins."""
    needs = RELEASE[name].get('needs', [])
    direct = {needs} if isinstance(needs, str) else set(needs)
    return direct.union(*map(awaited, direct))


def test_each_action_is_one_commit_whose_version_is_told() -> None:
    """A tag of somebody else's can be moved to what reads the secrets of this project."""
    lines = re.findall(r'uses: (.*)', ''.join(file.read_text() for file in FILES))
    foreign = {line for line in lines if not line.startswith(OWN)}
    assert [line for line in foreign if not PINNED.fullmatch(line)] == []
    names = [line.partition('@')[0] for line in foreign]
    assert sorted(set(names)) == sorted(names), 'an action in two versions'


def test_what_is_run_is_here() -> None:
    run = '\n'.join(commands())
    scripts = set(re.findall(r'(?<!\w)\.ci/[\w-]+', run))
    assert {'.ci/packages', '.ci/run', '.ci/long'} <= scripts
    assert [name for name in scripts if not os.access(ROOT / name, os.X_OK)] == []
    targets = set(re.findall(r'\bmake (?:--[\w-]+ )*([a-z-]+)$', run, re.MULTILINE))
    assert {'check', 'test', 'test-long', 'release'} <= targets
    assert [x for x in targets if not re.search(rf'^{x}:', MAKEFILE, re.MULTILINE)] == []


def test_each_job_ends() -> None:
    """Without a limit a run that hangs holds a machine for six hours."""
    limits = {name: job.get('timeout-minutes') for name, job in jobs() if 'steps' in job}
    assert [name for name, limit in limits.items() if not limit] == []
    [own] = re.findall(r'timeout .* (\d+)m "./.ci/run"', (ROOT / '.ci' / 'run').read_text())
    assert limits['gate.gate'] > int(own), 'the gate says itself what took too long'


def test_jobs_may_write_only_what_they_are_for() -> None:
    assert [name for name, content in WORKFLOWS.items() if content['permissions']] == []
    granted = {
        (name, right)
        for name, job in jobs()
        for right, level in job['permissions'].items()
        if level != 'read'
    }
    assert granted == {
        ('release.attest', 'id-token'),
        ('release.attest', 'attestations'),
        ('release.draft', 'contents'),
        ('release.pypi', 'id-token'),
    }


def test_nothing_of_a_release_is_made_before_the_gate_was_green_for_its_commit() -> None:
    assert RELEASE['gate']['uses'] == f'{OWN}gate.yml'
    assert [name for name in RELEASE if name != 'gate' and 'gate' not in awaited(name)] == []


def test_people_decide_what_is_published() -> None:
    assert RELEASE['pypi']['environment']['name'] == 'pypi'
    assert 'draft' in awaited('pypi'), 'they have seen it before'
    draft = [step['run'] for step in RELEASE['draft']['steps'] if 'run' in step]
    [made] = re.findall(r'gh release create (.*)', '\n'.join(draft))
    assert '--draft' in made.split()


def test_pypi_gets_the_wheel_and_the_sdist_of_the_files_of_a_release() -> None:
    page = (ROOT / 'docs' / 'install.md').read_text()
    [table] = re.findall(r'## The files of a release\n(.*?)\n## ', page, re.DOTALL)
    files = re.findall(r'`(ros2.kafka.bridge-VERSION[^`]*)`', table)
    whole, parts = (
        step['with'] for step in uses(RELEASE['build']) if 'upload-artifact' in step['uses']
    )
    taken = [file for file in files if fnmatch(f'release/{file}', parts['path'])]
    assert [Path(file).suffix for file in taken] == ['.whl', '.gz']
    assert len(files) > len(taken)
    assert whole['path'] == 'release/'
    fetched, _ = uses(RELEASE['pypi'])
    assert fetched['with']['name'] == parts['name']


def test_releases_and_their_tests_have_the_syft_that_contributing_names() -> None:
    page = (ROOT / 'CONTRIBUTING.md').read_text()
    [named] = re.findall(r'syft@v[\d.]+\d', page)
    assert re.findall(r'syft@\S+', '\n'.join(commands())) == [named, named]
