"""A small disk of its own for the spools, so that it can be full."""

import ctypes
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Final

_SIZE: Final = '64m'
_NEW_MOUNTS: Final = 0x0002_0000  # CLONE_NEWNS


def mount_small_disk(place: Path, tell: Callable[[str], None]) -> bool:
    """Mount a small disk for this process and those that it starts; it goes with them.

    Returns:
        Whether it is there: it takes root. The directory is, in any case.
    """
    place.mkdir(parents=True)
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_NEW_MOUNTS):
        tell(f'no disk of their own for the spools: {os.strerror(ctypes.get_errno())}')
        return False
    commands = (
        ('mount', '--make-rprivate', '/'),
        ('mount', '-t', 'tmpfs', '-o', f'size={_SIZE}', 'tmpfs', str(place)),
    )
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            tell(f'no disk of their own for the spools: {done.stderr.strip()}')
            return False
    return True
