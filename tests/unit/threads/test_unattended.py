"""Threads that nobody waits for, and a process that ends while one of them is at work."""

import sys

from support.processes.terminal import finished

KNOWN = """
import threading
from ros2_kafka_bridge.threads import unattended
ended = threading.Event()
thread = unattended.start('a look', ended.wait)
print(unattended.is_any_left())
ended.set()
thread.join()
print(unattended.is_any_left(), end='')
"""
WORKER = """
import time
from ros2_kafka_bridge.process import worker
from ros2_kafka_bridge.threads import unattended
unattended.start('a look', lambda: time.sleep(600))
print('all was said', end='')
worker._leave(3)
"""


def run(script: str) -> tuple[int, str, str]:
    """Run it in a process of its own: here other tests may have left one."""
    done = finished([sys.executable, '-c', script])
    return done.returncode, done.stdout, done.stderr


def test_one_is_known_while_it_is_at_work() -> None:
    assert run(KNOWN) == (0, 'True\nFalse', '')


def test_a_worker_ends_beside_one_with_its_status_and_all_that_was_said() -> None:
    assert run(WORKER) == (3, 'all was said', '')
