"""The process of a replay, and the process that has started it."""

import os
import select
import subprocess
import sys
from pathlib import Path
from typing import Final

from support.processes.harness import eventually
from support.processes.lifetimes import ended

# A replay that is never done with its configuration.
HELD: Final = """\
#!{python}
import runpy, sys
from ros2_kafka_bridge.config import settings

settings.restored = lambda _: open({held!r}).read()
sys.argv = sys.argv[sys.argv.index('-m') + 1 :]
runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
"""

STARTER: Final = """
import sys, threading
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.replay_process import ReplayForm, ReplayOrder

sys.executable = sys.argv[1]
replay = ReplayRunner(lambda: None)
order = ReplayOrder({}, ReplayForm('orders.dead-letters', dry_run=True))
# Who has asked for it is done long before the replay is.
asking = threading.Thread(target=replay.start, args=(order,))
asking.start()
asking.join()
print('started', flush=True)
threading.Event().wait()
"""


def test_a_replay_ends_when_the_process_that_has_started_it_is_killed(tmp_path: Path) -> None:
    held, program = tmp_path / 'held', tmp_path / 'program'
    os.mkfifo(held)
    program.write_text(HELD.format(python=sys.executable, held=str(held)))
    program.chmod(0o700)
    command = [sys.executable, '-c', STARTER, str(program)]
    with ended(subprocess.Popen(command, stdout=subprocess.PIPE)) as starter:
        assert starter.stdout is not None
        assert starter.stdout.readline() == b'started\n'
        try:
            end = _writing_end(held)
        finally:
            starter.kill()
    try:
        gone = select.poll()
        gone.register(end, select.POLLERR)
        eventually(lambda: bool(gone.poll(0)), 60)
    finally:
        os.close(end)


def _writing_end(held: Path) -> int:
    """Open the pipe as soon as somebody reads it, and see that the reader stays."""
    found: list[int] = []

    def is_read() -> bool:
        try:
            found.append(os.open(held, os.O_WRONLY | os.O_NONBLOCK))
        except OSError:  # nobody reads it yet
            return False
        return True

    eventually(is_read, 60)
    reader = select.poll()
    reader.register(found[0], select.POLLERR)
    assert reader.poll(500) == []
    return found[0]
