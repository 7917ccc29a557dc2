"""How a process of the bridge starts another one, or becomes it."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from typing import NoReturn

from ros2_kafka_bridge.threads.stop import SIGNALS


def start_child(
    module: str,
    options: Sequence[str],
    kept: Sequence[int],
    *,
    stdin: int = subprocess.PIPE,
    stdout: int | None = None,
) -> subprocess.Popen[bytes]:
    """Start a module of the bridge as a process, with its signals held back.

    Ctrl-C, a closed terminal and systemd reach every process, and what they mean is for the
    supervisor to say: a child takes the signals over when it knows what to do with them.

    Args:
        module: Its name in `ros2_kafka_bridge`.
        options: Its arguments.
        kept: File descriptors that it keeps open.
        stdin: Its standard input, as for `Popen`.
        stdout: Its standard output, as for `Popen`.

    Raises:
        OSError: There is no room for a process.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        return subprocess.Popen(  # noqa: S603 (this program)
            _program(module, options),
            bufsize=0,
            stdin=stdin,
            stdout=stdout,
            pass_fds=kept,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def become(module: str, options: Sequence[str]) -> NoReturn:
    """Replace this process by a module of the bridge, with its process id and its signals.

    What is asked for on the way by a signal is kept for the module that takes over.

    Args:
        module: Its name in `ros2_kafka_bridge`.
        options: Its arguments.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    os.execv(sys.executable, _program(module, options))  # noqa: S606 (no shell is wanted)


def _program(module: str, options: Sequence[str]) -> list[str]:
    # -P: a directory that happens to be the current one is not searched for modules.
    return [sys.executable, '-P', '-m', f'ros2_kafka_bridge.{module}', *options]
