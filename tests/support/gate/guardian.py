"""Ends what is left of a run of the tests, however that has ended (leak_check.py).

    python guardian.py MARK

waits until its input is closed, which is when the run ends, and kills what carries the mark.
"""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

MARK: Final = 'ROS2_KAFKA_BRIDGE_TESTS'
_LOOK_S: Final = 0.01
_END_S: Final = 30.0  # what the kernel has not ended by then is stuck in it


def marked(mark: str) -> Iterator[int]:
    """The processes that carry a mark, or one that begins like it.

    What has ended, and what is somebody else's, carries none.
    """
    sign = f'{MARK}={mark}'.encode()
    for process in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            environ = (process / 'environ').read_bytes()
            if any(entry.startswith(sign) for entry in environ.split(b'\0')):
                yield int(process.name)


def kill(pid: int) -> None:
    """End a process at once, if it has not ended."""
    with contextlib.suppress(OSError):
        os.kill(pid, signal.SIGKILL)


def _kill_all(mark: str) -> None:
    """Kill what carries a mark, and what that has started meanwhile."""
    deadline_s = time.monotonic() + _END_S
    while (found := [*marked(mark)]) and time.monotonic() < deadline_s:
        for pid in found:
            kill(pid)
        time.sleep(_LOOK_S)


if __name__ == '__main__':
    sys.stdin.read()
    _kill_all(sys.argv[1])
