"""What the benchmarks say that a process has used."""

import itertools
import os
import subprocess
import sys
import time

import pytest

from benchmarks.processes import usage


def test_cpu_time_far_below_a_tick_of_the_system_is_seen() -> None:
    looks = [usage(os.getpid()).cpu_s for _ in range(100)]
    assert looks[-1] == pytest.approx(time.process_time(), abs=1.0)
    steps = [after - before for before, after in itertools.pairwise(looks)]
    assert 0 < min(steps) < 1 / os.sysconf('SC_CLK_TCK')


def test_a_process_that_has_ended_is_told() -> None:
    with subprocess.Popen([sys.executable, '-c', '']) as process:
        while process.poll() is None:
            time.sleep(0.01)
    with pytest.raises(ProcessLookupError, match=f'process {process.pid} has ended'):
        usage(process.pid)
