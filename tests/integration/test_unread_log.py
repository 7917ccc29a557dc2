"""A bridge whose log nobody reads: a full pipe in the place of standard error."""

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from support.bridges.routes import values
from support.bridges.workers import sized, there_and_back
from support.patience import patient
from support.processes.harness import START, Bench, eventually

from rig.processes import END_S, KILLED_S

COUNT = 2_000


@contextmanager
def unread(bench: Bench, config: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a bridge that can write not even one line."""
    read_end, write_end = os.pipe()
    os.write(write_end, bytes(fcntl.fcntl(write_end, fcntl.F_GETPIPE_SZ)))
    command = [sys.executable, *START, '--', str(config)]
    process = subprocess.Popen(command, stderr=write_end, env=bench.environ, process_group=0)
    os.close(write_end)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, 9)
        process.wait(patient(KILLED_S))
        os.close(read_end)


@pytest.mark.parametrize('workers', [1, 2])
def test_a_bridge_whose_log_nobody_reads_moves_all_and_ends(
    bench: Bench, topic: str, returned: str, workers: int
) -> None:
    config = bench.config(there_and_back(topic), workers=workers, kafka=bench.patient_kafka)
    bench.produce(topic, sized(COUNT))
    with unread(bench, config) as process:
        eventually(partial(bench.reaches, returned, COUNT), 90, lambda: f'{process.poll()=}')
        process.terminate()
        assert process.wait(patient(END_S)) == 0
    assert values(bench.records(returned, COUNT)) == sized(COUNT)
    assert bench.committed(bench.group, topic) == COUNT
