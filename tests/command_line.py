"""The command line in the process of the test: to start one takes longer than most commands."""

import contextlib
import io
import sys
from pathlib import Path

import pytest

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
