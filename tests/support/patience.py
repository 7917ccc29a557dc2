"""How long a test waits, and for what."""

import time
from collections.abc import Callable

from rig.patience import IS_CI, PATIENCE, patient

__all__ = ['IS_CI', 'PATIENCE', 'eventually', 'patient']


def eventually(
    condition: Callable[[], bool], timeout_s: float, what: Callable[[], str] = lambda: 'never'
) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + patient(timeout_s)
    while not condition():
        assert time.monotonic() < deadline, what()
        time.sleep(0.02)
