"""Children of the tests heed signals however the run was started.

In the background, or under nohup, they would inherit that these are ignored or blocked. SIGPIPE is
left out: Python ignores it, and gives its children the default again.
"""

import signal
from collections.abc import Iterator
from typing import Final

import pytest

HEEDED: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True, scope='session')
def _processes_heed_signals() -> Iterator[None]:
    before = {number: signal.signal(number, signal.SIG_DFL) for number in HEEDED}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, {*HEEDED, signal.SIGPIPE})
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    for number, handler in before.items():
        signal.signal(number, handler)
