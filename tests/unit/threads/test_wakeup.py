"""Anybody ends the wait of a thread, and writes to no file but that of its wakeup."""

import os
import signal
import sys
import threading
import time

import pytest
from support.processes.terminal import finished

from ros2_kafka_bridge.threads.wakeup import Wakeup


def test_a_wait_that_nobody_ends_lasts() -> None:
    began_s = time.monotonic()
    assert not Wakeup().wait(0.05)
    assert time.monotonic() - began_s >= 0.05


def test_one_that_is_rung_before_or_during_a_wait_ends_it() -> None:
    wakeup = Wakeup()
    wakeup.ring()
    began_s = time.monotonic()
    assert wakeup.wait(10)
    wakeup.clear()
    late = threading.Timer(0.1, wakeup.ring)
    late.start()
    assert wakeup.wait(10)
    assert time.monotonic() - began_s < 5
    late.join()


def test_one_that_is_rung_once_or_often_is_the_same() -> None:
    wakeup = Wakeup()
    for _ in range(3):
        wakeup.ring()
    assert wakeup.is_rung
    assert wakeup.wait(10), 'a wait forgets nothing'
    assert wakeup.wait(10)
    wakeup.clear()
    assert not wakeup.is_rung
    assert not wakeup.wait(0.01)
    wakeup.clear()
    assert not wakeup.wait(0.01), 'to forget what was not is nothing'


def test_the_handler_of_a_signal_may_ring_for_the_thread_that_it_interrupts() -> None:
    wakeup = Wakeup()
    before = signal.signal(signal.SIGUSR1, lambda *_: wakeup.ring())
    late = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGUSR1))
    try:
        began_s = time.monotonic()
        late.start()
        assert wakeup.wait(10)
        assert time.monotonic() - began_s < 5
    finally:
        late.join()
        signal.signal(signal.SIGUSR1, before)


def test_it_is_closed_with_its_last_reference_and_not_before() -> None:
    wakeup = Wakeup()
    descriptor, ring = wakeup.descriptor, wakeup.ring
    del wakeup
    ring()
    os.fstat(descriptor)
    del ring
    with pytest.raises(OSError, match='Bad file descriptor'):
        os.fstat(descriptor)


def test_it_stays_open_where_somebody_may_write_to_it_for_ever() -> None:
    wakeup = Wakeup()
    descriptor = wakeup.descriptor
    wakeup.keep_open()
    del wakeup
    os.eventfd_write(descriptor, 1)
    os.close(descriptor)


def test_a_child_that_runs_another_program_does_not_inherit_it() -> None:
    wakeup = Wakeup()
    assert not os.get_inheritable(wakeup.descriptor)


def test_it_stays_open_to_the_very_end_of_the_program() -> None:
    """The handler of a signal may ring while the interpreter ends."""
    program = (
        'import atexit, os\n'
        'from ros2_kafka_bridge.threads.wakeup import Wakeup\n'
        'atexit.register(lambda: wakeup.ring() or print("rung"))\n'
        'wakeup = Wakeup()\n'
    )
    done = finished([sys.executable, '-c', program])
    assert (done.stdout, done.stderr) == ('rung\n', '')
