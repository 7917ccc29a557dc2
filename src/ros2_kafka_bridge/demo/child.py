"""A process that tells its counters through a pipe, and what it prints in a file."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Self

from ros2_kafka_bridge.route.counters import Snapshot, from_line

_KILLED_S: Final = 5.0
_TAIL_LINES: Final = 8

# A child must not outlive a demo that was killed: the kernel then asks it to end. Set by a program
# of its own, because code between fork and exec is not safe in a process with threads.
_END_WITH_OWNER: Final = (
    'import ctypes, os, sys\n'
    'ctypes.CDLL(None).prctl(1, 15)\n'  # PR_SET_PDEATHSIG, SIGTERM
    'if os.getppid() == int(sys.argv[1]): os.execv(sys.argv[2], sys.argv[2:])\n'
)


class Child:
    """A process that ends with its `with`, at the latest.

    Args:
        name: What a person calls it.
        command: What to start; `--snapshots FD` is added.
        log: Where its output goes.
        environ: Added to this process's own environment.
    """

    def __init__(
        self, name: str, command: Sequence[str], log: Path, environ: Mapping[str, str]
    ) -> None:
        self.snapshots: dict[str, Snapshot] = {}  # the last one of each route
        self.log = log
        self._name = name
        self._command = command
        self._environ = environ
        self._popen: subprocess.Popen[bytes] | None = None
        self._listener: threading.Thread | None = None

    def __enter__(self) -> Self:
        read, write = os.pipe()
        owned = [sys.executable, '-I', '-S', '-c', _END_WITH_OWNER, str(os.getpid())]
        with self.log.open('ab') as output:
            self._popen = subprocess.Popen(  # noqa: S603 (our own program)
                [*owned, *self._command, '--snapshots', str(write)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=(write,),
                env={**os.environ, **self._environ},
                start_new_session=True,  # Ctrl-C is for the demo, which ends this one in order
            )
        os.close(write)
        self._listener = threading.Thread(
            target=self._listen, args=(read,), name='listener', daemon=True
        )
        self._listener.start()
        return self

    def __exit__(self, *_: object) -> None:
        assert self._listener is not None
        self._process.kill()  # one that has ended gets nothing
        self._process.wait()
        self._listener.join(_KILLED_S)

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def ask_to_end(self) -> None:
        """Send SIGTERM, if it runs."""
        self._process.terminate()

    def story(self) -> str:
        """Say how it ended, with the last lines of its log."""
        status = self._process.wait()
        how = f'with exit status {status}'
        if status < 0:
            how = f'by {signal.Signals(-status).name}: its counters are those that it told last'
        lines = self.log.read_text(encoding='utf-8', errors='replace').splitlines()
        return '\n    '.join([f'{self._name} ended {how}', *lines[-_TAIL_LINES:]])

    @property
    def _process(self) -> subprocess.Popen[bytes]:
        assert self._popen is not None, 'it was started'
        return self._popen

    def _listen(self, descriptor: int) -> None:
        """Note every snapshot that comes, until all who could write one have closed the pipe."""
        with open(descriptor, 'rb') as lines:
            for line in lines:
                # Another dictionary: this one may be walked through meanwhile.
                self.snapshots = self.snapshots | {told.route: told for told in from_line(line)}
