"""How a process of a run is given up: what it was at stays beside its log."""

import signal

from benchmarks.faults.stacks import write_stacks
from rig.processes import Process, ProcessError


def end(process: Process, timeout_s: float) -> int | None:
    """Ask it to end, and kill it when it does not in time; returns its exit status.

    None says that it was never started, or had to be killed; what it was at stands beside its log.
    """
    if process.status is None and not process.running:
        return None
    process.send(signal.SIGCONT)
    try:
        return process.end(timeout_s)
    except ProcessError:
        tell_stacks(process)
        return None
    finally:
        process.kill()


def tell_stacks(process: Process) -> None:
    """Write down what its threads are at, if it runs; the file stands beside its log."""
    if process.running:
        write_stacks(process.pid, process.log.with_suffix('.stacks'))
