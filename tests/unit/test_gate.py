"""The rules of the gate, on runs of pytest with tests of their own."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.bridges.workers import gone
from support.patience import eventually
from support.processes.terminal import finished

TESTS = Path(__file__).parents[1]
SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
PLUGINS = ('-p', 'timeout', '-p', 'rerunfailures', '-p', 'xdist')
COMMAND = (sys.executable, '-m', 'pytest', *PLUGINS)
RULES = ('signals', 'limits', 'leak_check', 'reruns', 'skips')
CONFTEST = f'pytest_plugins = {tuple(f"support.gate.{rule}" for rule in RULES)}\n'
ONCE = """
from pathlib import Path

import pytest

@pytest.mark.parametrize('number', range({count}))
def test_is_late_once(number):
    seen = Path(__file__).with_name(f'seen-{{number}}')
    if not seen.exists():
        seen.touch()
        raise AssertionError('the first time')
"""

FIXTURE = """
import time, pytest

@pytest.fixture
def slow():
    if '{where}' == 'before':
        time.sleep(1000)
    yield
    time.sleep(1000)

def test_it(slow):
    pass
"""
BOTH = """
import pytest

@pytest.fixture
def bad():
    yield
    raise RuntimeError

def test_it(bad):
    raise ValueError
"""
CHILD = """
import re
import subprocess

def test_child():
    said = subprocess.check_output(['cat', '/proc/self/status'], text=True)
    for what in ('SigIgn', 'SigBlk'):
        mask = int(re.search(rf'{what}:(.*)', said)[1], 16)
        assert not any(mask >> (number - 1) & 1 for number in (1, 2, 15)), said
"""

# A grandchild that is in no group of its parent's, and has outlived it.
LEAVES = """
import subprocess, sys, time
from pathlib import Path

def test_it():
    place = Path(__file__).with_name('pid')
    subprocess.run(['sh', '-c', f'setsid sleep 1000 & echo $! > {place}'], check=True)
    left = Path(f'/proc/{place.read_text().strip()}/cmdline')
    while not left.read_bytes().startswith(b'sleep'):  # one that just begins shows no environment
        time.sleep(0.01)
    while {hangs}:
        time.sleep(1)
"""
SHARES = """
import subprocess, pytest

@pytest.fixture(scope='module')
def shared():
    with subprocess.Popen(['sleep', '1000']) as process:
        yield process
        process.kill()

@pytest.mark.parametrize('number', range(2))
def test_it(shared, number):
    assert shared.poll() is None
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The rules, and folders without tests."""
    (tmp_path / 'pytest.ini').write_text(
        '[pytest]\ntimeout_method = signal\ntimeout_func_only = true\n'
    )
    shutil.copytree(TESTS / 'support' / 'gate', tmp_path / 'support' / 'gate')
    shutil.copy(TESTS / 'support' / 'patience.py', tmp_path / 'support')
    (tmp_path / 'conftest.py').write_text(CONFTEST)
    for name in ('unit', 'integration'):
        (tmp_path / name).mkdir()
    return tmp_path


def run(tree: Path, *options: str, deaf: bool = False, **environ: str) -> tuple[int, str]:
    """The status of a run, and what it printed."""
    done = finished(
        [*COMMAND, *options, str(tree)],
        timeout_s=25,
        cwd=tree,
        env={**environ_of(tree), **environ},
        preexec_fn=_deaf if deaf else None,
    )
    return done.returncode, done.stdout


def environ_of(tree: Path) -> dict[str, str]:
    """The environment of a run, alone with its own plugins."""
    alone = {'PYTHONPATH': f'{tree}:{TESTS.parent}', 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'}
    return {'PATH': '/usr/bin:/bin', **alone}


def _deaf() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


def counts(said: str) -> dict[str, int]:
    """What became of the tests, from pytest's closing line."""
    found = re.findall(r'(\d+) (passed|failed|rerun|skipped)', said.splitlines()[-1])
    return {what: int(count) for count, what in found}


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_a_test_that_starts_processes_is_run_again_once_and_that_is_told(
    tree: Path, options: tuple[str, ...]
) -> None:
    (tree / 'integration' / 'test_late.py').write_text(ONCE.format(count=3))
    status, said = run(tree, *options)
    assert status == 0, said
    assert 'AssertionError: the first time' in said.partition('run again')[2]
    assert '3 of the tests needed a second run\n' in said
    assert counts(said) == {'passed': 3, 'rerun': 3}


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_more_than_three_that_are_run_again_make_a_run_red(
    tree: Path, options: tuple[str, ...]
) -> None:
    (tree / 'integration' / 'test_late.py').write_text(ONCE.format(count=4))
    status, said = run(tree, *options)
    assert status == 1
    assert '4 of the tests needed a second run: more than 3, so this run is red' in said


def test_a_unit_test_is_never_run_again(tree: Path) -> None:
    (tree / 'unit' / 'test_late.py').write_text(ONCE.format(count=1))
    status, said = run(tree)
    assert status == 1
    assert counts(said) == {'failed': 1}


def test_a_test_that_hangs_fails_each_time_it_is_run(tree: Path) -> None:
    (tree / 'integration' / 'test_hangs.py').write_text(
        'import time, pytest\n@pytest.mark.timeout(10)\ndef test_hangs():\n    time.sleep(1000)\n'
    )
    status, said = run(tree, '-n', '2', TEST_PATIENCE='0.1')
    assert status == 1
    assert 'Timeout (>1.0s)' in said
    assert counts(said) == {'failed': 1, 'rerun': 1}


@pytest.mark.parametrize('where', ['before', 'after'])
def test_a_fixture_that_hangs_fails_each_time_it_is_used(tree: Path, where: str) -> None:
    (tree / 'integration' / 'test_hangs.py').write_text(FIXTURE.format(where=where))
    status, said = run(tree, TEST_PATIENCE='0.01')
    assert status == 1
    assert 'Timeout (>1.5s) of fixtures that ' in said
    assert counts(said)['rerun'] == 1


def test_the_fixtures_of_a_long_test_have_as_long_as_it(tree: Path) -> None:
    long = '@pytest.mark.timeout(250)\ndef test_it'
    (tree / 'integration' / 'test_hangs.py').write_text(
        FIXTURE.format(where='before').replace('def test_it', long)
    )
    status, said = run(tree, TEST_PATIENCE='0.01')
    assert status == 1
    assert 'Timeout (>2.5s) of fixtures that ' in said


def test_a_test_that_fails_in_its_body_and_at_its_end_was_run_again_once(tree: Path) -> None:
    (tree / 'integration' / 'test_both.py').write_text(BOTH)
    status, said = run(tree)
    assert status == 1
    assert '1 of the tests needed a second run' in said


@pytest.mark.parametrize(
    'skipping',
    [
        'def test_it():\n    pytest.skip("no browser")\n',
        '@pytest.mark.skipif(True, reason="no browser")\ndef test_it():\n    pass\n',
        'pytest.skip("no browser", allow_module_level=True)\n',
    ],
    ids=['in a test', 'by a mark', 'of a file'],
)
def test_a_skip_is_a_failure_where_it_must_not_be(tree: Path, skipping: str) -> None:
    (tree / 'unit' / 'test_skips.py').write_text(f'import pytest\n\n{skipping}')
    assert run(tree)[0] in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}
    status, said = run(tree, CI='true')
    assert status in {pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.INTERRUPTED}
    assert 'no browser: with CI=true a skip is a failure (tests/support/gate)' in said


def test_a_skip_that_is_a_failure_is_one_also_where_tests_are_run_again(tree: Path) -> None:
    (tree / 'integration' / 'test_skips.py').write_text(
        'import pytest\n\ndef test_it():\n    pytest.skip("no browser")\n'
    )
    status, said = run(tree, CI='true')
    assert (status, counts(said)['failed']) == (1, 1), said


def test_what_no_project_can_install_may_be_skipped(tree: Path) -> None:
    (tree / 'unit' / 'test_skips.py').write_text(
        'import pytest\n\n'
        'def test_it():\n'
        '    pytest.skip("a small disk cannot be mounted here: not root")\n'
    )
    status, said = run(tree, CI='true')
    assert status == 0, said


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_children_take_every_signal_however_the_run_was_started(
    tree: Path, options: tuple[str, ...]
) -> None:
    (tree / 'unit' / 'test_child.py').write_text(CHILD)
    status, said = run(tree, *options, deaf=True)
    assert status == 0, said


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_what_outlives_its_test_is_killed_and_makes_it_fail(
    tree: Path, options: tuple[str, ...]
) -> None:
    (tree / 'unit' / 'test_leaves.py').write_text(LEAVES.replace('{hangs}', 'False'))
    status, said = run(tree, *options, TEST_PATIENCE='0.1')
    assert status == 1
    pid = int((tree / 'unit' / 'pid').read_text())
    assert 'outlived its test, and was killed:' in said
    assert f'{pid}: sleep 1000' in said
    assert gone(pid)


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_what_several_tests_share_outlives_each_of_them(
    tree: Path, options: tuple[str, ...]
) -> None:
    (tree / 'integration' / 'test_shares.py').write_text(SHARES)
    status, said = run(tree, *options)
    assert (status, counts(said)) == (0, {'passed': 2}), said


@pytest.mark.parametrize('options', [(), ('-n', '2')], ids=['one process', 'two'])
def test_nothing_outlives_a_run_that_is_killed(tree: Path, options: tuple[str, ...]) -> None:
    (tree / 'unit' / 'test_leaves.py').write_text(LEAVES.replace('{hangs}', 'True'))
    place = tree / 'unit' / 'pid'
    with subprocess.Popen(
        [*COMMAND, *options, str(tree)], cwd=tree, env=environ_of(tree), stdout=subprocess.DEVNULL
    ) as process:
        eventually(lambda: place.exists() and place.read_text().strip() != '', 25)
        process.kill()
    eventually(lambda: gone(int(place.read_text())), 25)
