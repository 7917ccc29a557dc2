"""Commands as people type them: in a terminal, or in the process of the test."""

import contextlib
import io
import os
import pty
import re
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from support.patience import patient
from support.processes.lifetimes import ended

from rig.processes import KILLED_S
from ros2_kafka_bridge.cli import main


class Terminal:
    """A terminal with one program in it, which gets SIGHUP when it is closed."""

    def __init__(self, *command: str, environ: dict[str, str], log: Path | None) -> None:
        self._master, its_end = pty.openpty()
        with nullcontext(its_end) if log is None else log.open('wb') as stderr:
            self.program = subprocess.Popen(
                ['setsid', '--ctty', *command],
                stdin=its_end,
                stdout=its_end,
                stderr=stderr,
                env=environ,
            )
        os.close(its_end)
        self._shown = b''

    def types(self, keys: str) -> None:
        """Press keys: a line end is enter, a control character Ctrl and a letter."""
        os.write(self._master, keys.encode())

    def shows(self, text: bytes) -> bool:
        """Whether a text has come so far."""
        os.set_blocking(self._master, False)
        try:
            while data := os.read(self._master, 65536):
                self._shown += data
        except OSError:  # nothing more, or its end
            pass
        return text in self._shown

    def shown(self) -> str:
        """What has come so far."""
        self.shows(b'')
        return self._shown.decode(errors='replace')

    def close(self) -> None:
        """Close it, as the button of its window does."""
        os.close(self._master)


@contextmanager
def terminal(
    *command: str, environ: dict[str, str], log: Path | None = None
) -> Iterator[Terminal]:
    """Run a program on a terminal; with a log, its errors go there."""
    found = Terminal(*command, environ=environ, log=log)
    try:
        yield found
    finally:
        found.program.kill()
        found.program.wait(patient(KILLED_S))


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


def typed(*words: str | Path) -> tuple[int, str, str]:
    """Run a command to its end; returns status, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, 'argv', ['ros2-kafka-bridge', *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
    assert isinstance(end.value.code, int)
    return end.value.code, out.getvalue(), err.getvalue()


def finished(
    command: Sequence[str | Path], timeout_s: float = 120.0, **more: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, whatever its status; `more` is for `subprocess.run`.

    Raises:
        subprocess.TimeoutExpired: It is not through in time.
    """
    return subprocess.run(
        command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        timeout=patient(timeout_s), **more,
    )  # fmt: skip
