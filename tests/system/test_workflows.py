""".github/workflows: actionlint finds no mistake (nor shellcheck in scripts, where it is here)."""

import shutil

import pytest
from support.install.checkout import ROOT
from support.processes.terminal import finished


def test_the_workflows_are_what_a_forge_takes() -> None:
    program = shutil.which('actionlint')
    if program is None:
        pytest.skip('workflows cannot be checked here: needs actionlint')
    files = sorted((ROOT / '.github' / 'workflows').glob('*.yml'))
    done = finished([program, '-no-color', *files])
    assert (done.returncode, done.stdout + done.stderr) == (0, '')
