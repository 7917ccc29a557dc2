"""Children of the tests take signals however the run was started.

In the background, or under nohup, they would inherit that these are ignored or blocked. SIGPIPE is
left out: Python ignores it, and gives its children the default again.
"""

import signal
from collections.abc import Iterator
from typing import Final

import pytest

TAKEN: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True, scope='session')
def _processes_take_signals() -> Iterator[None]:
    before = {number: signal.signal(number, signal.SIG_DFL) for number in TAKEN}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, {*TAKEN, signal.SIGPIPE})
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    for number, handler in before.items():
        signal.signal(number, handler)
