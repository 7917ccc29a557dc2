"""Commands, run to their end: in a process, or where to start one takes too long in the test's."""

import contextlib
import io
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from patience import patient

from ros2_kafka_bridge.cli import main


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
