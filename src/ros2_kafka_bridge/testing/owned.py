"""Processes that do not outlive the program that started them, even where it was killed."""

import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Thread
from typing import Final

# The kernel sends this signal when the *thread* that started the process ends, hence `_own`. Set
# in the child by a program of its own: code between fork and exec is not safe in a process with
# threads.
_DIE_WITH_OWNER: Final = (
    'import ctypes, os, sys\n'
    'ctypes.CDLL(None).prctl(1, 9)\n'  # PR_SET_PDEATHSIG, SIGKILL
    'if os.getppid() == int(sys.argv[1]): os.execvp(sys.argv[2], sys.argv[2:])\n'
)


def start_owned(command: Sequence[str], log_file: Path) -> subprocess.Popen[bytes]:
    """Start a process that ends with this one, however this one ends.

    It is in the network of the calling thread (see `hosts.Host.entered`).

    Args:
        command: The program and its arguments.
        log_file: What it prints is appended here.

    Raises:
        OSError: The log cannot be written.
    """
    started: Future[subprocess.Popen[bytes]] = Future()
    name = f'owner of {Path(command[0]).name}'
    Thread(target=_own, args=(command, log_file, started), name=name, daemon=True).start()
    return started.result()


def _own(command: Sequence[str], log_file: Path, started: Future[subprocess.Popen[bytes]]) -> None:
    """Start a process and live as long as it does, because it does not live longer."""
    starter = [sys.executable, '-I', '-S', '-c', _DIE_WITH_OWNER, str(os.getpid())]
    try:
        with log_file.open('ab') as log:
            process = subprocess.Popen(  # noqa: S603 - a command of this project
                [*starter, *command],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,  # Ctrl-C is for the owner, who stops it in order
            )
    except OSError as error:
        started.set_exception(error)
        return
    started.set_result(process)
    process.wait()
