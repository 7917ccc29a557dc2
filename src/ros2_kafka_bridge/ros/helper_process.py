"""A module of the bridge in a process of its own, for as long as its answer is waited for."""

import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from ros2_kafka_bridge.threads.stop import SIGNALS


@contextmanager
def helper_process(
    module: str, options: Sequence[str] = (), **how: Any
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a module, which is killed at the end of `with`, whatever ends it.

    Of a group of its own: Ctrl-C, and what lets a group go on that has lost its session, is for
    this process.

    Args:
        module: By its whole name.
        options: Its arguments.
        how: As of `subprocess.Popen`.

    Raises:
        OSError: It cannot be started.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        process = subprocess.Popen(  # noqa: S603 (this program)
            [sys.executable, '-P', '-m', module, *options], process_group=0, **how
        )
        with process:
            try:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
                yield process
            finally:
                process.kill()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
