"""Who has a spool open: a lock on a file beside it, which also holds a copy of the ledger."""

import fcntl
import os
import time
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import RouteError, SpoolInUseError
from ros2_kafka_bridge.spool.ledger import LEDGER_BYTES, Ledger, newest

_PID_BYTES: Final = 16
_PATIENCE_S: Final = 1.0  # a bridge that is just ending has it a moment longer
_NAMESPACE: Final = Path('/proc/self/ns/pid')


def lock_of(path: Path) -> Path:
    """The lock file of a spool."""
    return path.with_name(f'{path.name}.lock')


class Holder(NamedTuple):
    """Who has a spool open.

    Args:
        is_open: Whether a process has; None where that cannot be seen.
        pid: Its number; 0 where none has, None where it is not known: that of a process in another
            container is another's here.
    """

    is_open: bool | None
    pid: int | None


class FileLock:
    """An exclusive lock on the file beside a spool; the kernel lets go of it with the process."""

    def __init__(self, path: Path) -> None:
        self._is_claimed = False  # kept whoever releases it
        self._path = path
        self._file = -1

    def take(self, patience_s: float = _PATIENCE_S) -> None:
        """Lock; nothing where it is locked by this object already.

        Args:
            patience_s: How long to wait for another process.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: The file cannot be written.
        """
        if self._file >= 0:
            return
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            self._file = os.open(self._path, flags, 0o600)
        except OSError as error:
            raise RouteError(
                f'{self._path} cannot be written: {error.strerror}: let the user of the bridge '
                'write there, or set spool.path to another directory'
            ) from error
        try:
            self._wait(patience_s)
            os.pwrite(self._file, _own_name(), 0)
        except OSError as error:
            self.release()
            raise RouteError(f'{self._path} cannot be locked: {error.strerror}') from error
        except RouteError:
            self.release()
            raise

    def claim(self, patience_s: float) -> None:
        """Lock, and keep it until `disclaim`, whoever releases it meanwhile.

        Raises:
            SpoolInUseError: Another process has it.
            RouteError: The file cannot be written.
        """
        self.take(patience_s)
        self._is_claimed = True

    def disclaim(self) -> None:
        """Keep it no longer than whoever has it open."""
        self._is_claimed = False

    def _wait(self, patience_s: float) -> None:
        deadline_s = time.monotonic() + patience_s
        while True:
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                if time.monotonic() < deadline_s:
                    time.sleep(0.02)
                    continue
                pid = _pid(os.pread(self._file, _PID_BYTES, 0))
                raise SpoolInUseError(pid, self._path) from error
            return

    def ledger(self) -> Ledger | None:
        """The copy that was kept last, None where there is none."""
        return newest(os.pread(self._file, LEDGER_BYTES, _PID_BYTES))

    def keep(self, ledger: Ledger) -> None:
        """Keep a copy; costs a write into the system's memory, never one to the disk."""
        os.pwrite(self._file, ledger.pack(), _PID_BYTES)

    def release(self) -> None:
        """Unlock, unless it is claimed; the file stays."""
        if self._file >= 0 and not self._is_claimed:
            os.close(self._file)
            self._file = -1


def is_in_use(path: Path) -> bool:
    """Whether a process has a spool open, by its lock file.

    The kernel knows, also of processes in another container. Who takes the lock at the same
    moment has patience. Where it cannot be seen, nobody counts as having it.
    """
    return bool(_is_locked(path))


def _is_locked(path: Path) -> bool | None:
    """Whether a lock file is locked; None where that cannot be seen."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except FileNotFoundError:
        return False
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return None
    else:
        return False
    finally:
        os.close(file)


def copy_in(path: Path) -> Ledger | None:
    """The copy of the ledger in a lock file, None where there is none. Changes nothing."""
    try:
        return newest(path.read_bytes()[_PID_BYTES : _PID_BYTES + LEDGER_BYTES])
    except OSError:
        return None


def holder(path: Path) -> Holder:
    """Who has a spool open, by its lock file. Changes nothing."""
    is_open = _is_locked(path)
    if not is_open:
        return Holder(is_open, pid=None if is_open is None else 0)
    try:
        return Holder(is_open, pid=_pid(path.read_bytes()[:_PID_BYTES]) or None)
    except OSError:
        return Holder(is_open, pid=None)


def _own_name() -> bytes:
    """The number of this process, and of the container in which it is that."""
    return (b'%d %x' % (os.getpid(), _namespace())).ljust(_PID_BYTES)


def _namespace() -> int:
    try:
        return _NAMESPACE.stat().st_ino
    except OSError:
        return 0


def _pid(name: bytes) -> int:
    words = name.split(b'\0')[0].split()
    if len(words) != 2 or not words[0].isdigit() or words[1] != b'%x' % _namespace():
        return 0
    return int(words[0])
