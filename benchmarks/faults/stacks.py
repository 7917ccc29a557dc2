"""What every thread of a process is at: for one that does not end, or stands still."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

_WAIT_S: Final = 60.0


def write_stacks(pid: int, file: Path) -> None:
    """Append the stacks of a process to a file: in Python by py-spy, below that by gdb.

    A process that is given up is killed a moment later, and with it goes the only hint: nothing
    that fails here ends a run.

    Args:
        pid: Which process; to look at it needs its user's rights, or root's.
        file: Of all stacks of this process.
    """
    commands = (
        [str(Path(sys.executable).with_name('py-spy')), 'dump', '--pid', str(pid)],
        ['gdb', '-p', str(pid), '-batch', '-ex', 'thread apply all backtrace'],
    )
    with file.open('a') as log:
        for command in commands:
            print(f'\n{" ".join(command)}', file=log, flush=True)
            if shutil.which(command[0]) is None:
                print('is not here', file=log, flush=True)
                continue
            try:
                subprocess.run(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    timeout=_WAIT_S,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                print(f'has not ended within {_WAIT_S:.0f} s', file=log, flush=True)
