"""A terminal of a given width, for what the commands show to people."""

import os
import pty
import re
import select
import subprocess
import sys
import time

from ending import ended
from patience import patient


def on_terminal(*arguments: str, columns: int) -> tuple[int, str]:
    """Run the command line in a terminal; its status and what it shows, colours included."""
    outer, inner = pty.openpty()
    command = [sys.executable, '-m', 'ros2_kafka_bridge', *arguments]
    environ = {**os.environ, 'COLUMNS': str(columns), 'TERM': 'xterm-256color'}
    program = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=inner, stderr=subprocess.DEVNULL, env=environ
    )
    os.close(inner)
    shown = b''
    deadline_s = time.monotonic() + patient(60)
    with ended(program):
        while part := _read(outer, deadline_s, shown):
            shown += part
        status = program.wait(patient(20))
    os.close(outer)
    return status, shown.decode()


def without_colours(shown: str) -> list[str]:
    """The lines that a terminal shows."""
    return re.sub(r'\x1b\[[0-9;?]*[A-Za-z]', '', shown).splitlines()


def _read(terminal: int, deadline_s: float, shown: bytes) -> bytes:
    left_s = max(0.0, deadline_s - time.monotonic())
    assert select.select([terminal], [], [], left_s)[0], f'it does not end: {shown.decode()}'
    try:
        return os.read(terminal, 4096)
    except OSError:  # its last program has ended
        return b''
