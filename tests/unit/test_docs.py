"""The pages made from the settings are those of today's settings."""

import subprocess
import sys
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
