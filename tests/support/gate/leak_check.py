"""Nothing outlives its test, nor a run of the tests.

All that a run starts carries its mark in its environment, its grandchildren as well. What is
found with it behind a test is killed, and that test fails. What is left when a run has ended,
though by SIGKILL, is killed by its guardian.
"""

import contextlib
import os
import re
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final

import pytest
from support.gate import guardian
from support.gate.guardian import MARK, kill, marked
from support.gate.limits import tier
from support.patience import patient

END_S: Final = 2.0  # for what has been told to end, or killed, just now
_LOOK_S: Final = 0.01
# Python starts these of its own, once for all tests.
_OF_PYTHON: Final = re.compile(rb'from multiprocessing\.(forkserver|resource_tracker) import')
_known: Final = pytest.StashKey[set[int]]()


def pytest_configure(config: pytest.Config) -> None:
    """Mark all that is started from now on; a worker of pytest-xdist has a mark of its own."""
    config.stash[_known] = set()
    worker = getattr(config, 'workerinput', None)
    if worker is not None:
        os.environ[MARK] += f'.{worker["workerid"]}.'
        return
    mark = uuid.uuid4().hex
    config.add_cleanup(_guarded(mark))
    os.environ[MARK] = mark


def _guarded(mark: str) -> Callable[[], None]:
    """Start the guardian of a run; returns what has it end what is left."""
    command = [sys.executable, '-I', '-S', guardian.__file__, mark]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)

    def end() -> None:
        process.communicate()

    return end


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(request: pytest.FixtureRequest) -> Generator[None, Any, Any]:
    """Know what a fixture of several tests has started."""
    if request.scope == 'function':
        return (yield)
    before = {*marked(os.environ[MARK])}
    try:
        return (yield)
    finally:
        request.config.stash[_known] |= {*marked(os.environ[MARK])} - before


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, None, None]:
    """Look for what is still there, behind the end of the fixtures.

    Unit tests, which are thousands and quick, are looked at file by file.
    """
    try:
        yield
    finally:
        if tier(item) != 'unit' or nextitem is None or nextitem.path != item.path:
            left = _end_others(item.config.stash[_known])
            if left:
                pytest.fail('\n'.join(['outlived its test, and was killed:', *left]))


def _end_others(known: set[int]) -> list[str]:
    """Kill what a test has left, once it had the time to end; returns a line for each."""
    deadline_s = time.monotonic() + patient(END_S)
    while (others := _others(known)) and time.monotonic() < deadline_s:
        time.sleep(_LOOK_S)
    for pid in others:
        kill(pid)
    return [f'{pid}: {command}' for pid, command in others.items()]


def _others(known: set[int]) -> dict[int, str]:
    found = {}
    for pid in {*marked(os.environ[MARK])} - known:
        with contextlib.suppress(OSError):
            command = Path(f'/proc/{pid}/cmdline').read_bytes()
            parent = int(Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[1])
            # What is forked from one of Python's own has the same command.
            if parent != os.getpid() or not _OF_PYTHON.search(command):
                found[pid] = command.replace(b'\0', b' ').decode(errors='replace')
    return found
