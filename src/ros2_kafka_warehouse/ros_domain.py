"""One warehouse in a ROS domain: a lock that all warehouses of this machine look at."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from ros2_kafka_warehouse.run_options import Options, StartError

# Not that of TMPDIR, which may be another one for each user: all warehouses look at one place.
_LOCKS: Final = Path('/tmp')  # noqa: S108 (a name that others know is what it is for)
_PID_BYTES: Final = 16


def domain_of(options: Options) -> int:
    """The ROS domain that is asked for, or that of the environment.

    Raises:
        StartError: The environment names none.
    """
    if options.domain is not None:
        return options.domain
    text = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not text.isdecimal():
        raise StartError(f'ROS_DOMAIN_ID is {text!r}: a number is needed, or --domain')
    return int(text)


@contextmanager
def claim_domain(domain: int) -> Iterator[None]:
    """Keep other warehouses of this machine out of a ROS domain meanwhile.

    Two in one domain hear each other's orders and states, and send each other's robots about. The
    lock ends with this process, however that ends: what it starts does not inherit it.

    Raises:
        StartError: Another warehouse is there.
    """
    lock = _open_for_all(_LOCKS / f'warehouse-ros-domain-{domain}.lock')
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = os.pread(lock, _PID_BYTES, 0).decode(errors='replace').strip() or 'unknown'
            raise StartError(
                f'another warehouse (process {pid}) is in ROS domain {domain}: choose another '
                'with --domain, or end that one'
            ) from None
        with suppress(OSError):  # a full disk: the lock counts, the number is for a message alone
            os.pwrite(lock, str(os.getpid()).encode().ljust(_PID_BYTES), 0)
        yield
    finally:
        os.close(lock)


def _open_for_all(path: Path) -> int:
    """Open a file that every user of this machine may lock; make it if it is not there."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    with suppress(FileNotFoundError):
        # Without O_CREAT: in /tmp the kernel refuses that for the file of another user.
        return os.open(path, flags)
    lock = os.open(path, flags | os.O_CREAT, 0o666)
    os.fchmod(lock, 0o666)  # whatever the umask
    return lock
