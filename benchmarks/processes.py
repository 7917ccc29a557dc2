"""What the kernel says that a measured process uses, and the programs around it."""

import contextlib
import itertools
import time
from pathlib import Path
from typing import Final, NamedTuple

from rig.processes import Begin, Programs, owned, ros_here

_CPUCLOCK_SCHED: Final = 2  # linux/posix-timers.h
_GRACE_S: Final = 5.0


class Usage(NamedTuple):
    """What a process has used so far."""

    cpu_s: float
    anon_mib: float


def programs(place: Path, domain: int, begin: Begin = owned) -> Programs:
    """Programs that end in order: a node that is killed leaves its files in /dev/shm."""
    return Programs(place, ros_here(domain), begin=begin, grace_s=_GRACE_S)


def usage(pid: int) -> Usage:
    """Look at what a process has used so far.

    Raises:
        ProcessLookupError: It has ended.
    """
    try:
        cpu_s = time.clock_gettime(_cpu_clock(pid))
        lines = Path('/proc', str(pid), 'status').read_text().splitlines()
    except OSError as error:
        raise ProcessLookupError(f'process {pid} has ended') from error
    status = dict(line.split(':', 1) for line in lines)
    if 'RssAnon' not in status:
        raise ProcessLookupError(f'process {pid} has ended')
    return Usage(cpu_s, int(status['RssAnon'].split()[0]) / 1024)


def of_family(pid: int) -> Usage:
    """Look at what a process has used, with its children and theirs.

    One that has just ended counts no more.
    """
    cpu_s = anon_mib = 0.0
    for one in _family(pid):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            seen = usage(one)
            cpu_s, anon_mib = cpu_s + seen.cpu_s, anon_mib + seen.anon_mib
    return Usage(cpu_s, anon_mib)


def _family(pid: int) -> list[int]:
    files = Path('/proc', str(pid), 'task').glob('*/children')
    children = itertools.chain(*(file.read_text().split() for file in files))
    return [pid, *(one for child in children for one in _family(int(child)))]


def _cpu_clock(pid: int) -> int:
    """The clock of all CPU time of a process: clock_getcpuclockid(3), which Python does not have.

    It counts in nanoseconds, where /proc/PID/stat counts in hundredths of a second: a small drain
    takes no more than a few of those.
    """
    return ~pid << 3 | _CPUCLOCK_SCHED
