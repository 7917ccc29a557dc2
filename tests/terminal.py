"""A terminal of a given width, for what the commands show to people."""

import os
import pty
import re
import subprocess
import sys


def on_terminal(*arguments: str, columns: int) -> tuple[int, str]:
    """Run the command line in a terminal; its status and what it shows, colours included."""
    outer, inner = pty.openpty()
    command = [sys.executable, '-m', 'ros2_kafka_bridge', *arguments]
    environ = {**os.environ, 'COLUMNS': str(columns), 'TERM': 'xterm-256color'}
    with subprocess.Popen(command, stdout=inner, stderr=subprocess.DEVNULL, env=environ) as run:
        os.close(inner)
        shown = b''
        while part := _read(outer):
            shown += part
    os.close(outer)
    return run.returncode, shown.decode()


def without_colours(shown: str) -> list[str]:
    """The lines that a terminal shows."""
    return re.sub(r'\x1b\[[0-9;?]*[A-Za-z]', '', shown).splitlines()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # its last program has ended
        return b''
