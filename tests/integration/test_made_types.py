"""Endpoints of types that are made, in a process with many threads."""

import subprocess
import sys

import pytest
from harness import PEERS
from patience import patient


@pytest.mark.usefixtures('ros_domain')
def test_threads_that_make_and_destroy_endpoints_at_once_never_stand_still() -> None:
    """No call of the middleware may let another thread of Python in: nobody would go on."""
    done = subprocess.run(
        [sys.executable, PEERS / 'made_types_churn.py', '8', '60'],
        capture_output=True,
        text=True,
        timeout=patient(60),
        check=False,
    )
    assert (done.stdout, done.stderr, done.returncode) == ('done\n', '', 0)
