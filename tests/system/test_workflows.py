""".github/workflows: actionlint finds no mistake (nor shellcheck in scripts, where it is here)."""

import shutil
import subprocess

import pytest
from pages import ROOT


def test_the_workflows_are_what_a_forge_takes() -> None:
    program = shutil.which('actionlint')
    if program is None:
        pytest.skip('workflows cannot be checked here: needs actionlint')
    files = sorted((ROOT / '.github' / 'workflows').glob('*.yml'))
    done = subprocess.run(
        [program, '-no-color', *files], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, '')
