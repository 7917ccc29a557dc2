"""The processes of the warehouse: started, started again when they die, stopped in order."""

import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.testing.owned import start_owned

_SHORTEST_S: Final = 0.5
_LONGEST_S: Final = 10.0
_STEADY_S: Final = 30.0  # one that has lived so long begins with the shortest wait again
_HUNG_S: Final = 20.0
_ABORT_S: Final = 2.0
_CRASHES: Final = 5  # so many in a row are a crash loop
_AGAIN_S: Final = 60.0  # after which one in a crash loop is tried again
_BEFORE_ALIVE: Final = 3  # times the time that it may be silent, until it is alive at first
_TAIL_LINES: Final = 6
_MOST_WORDS: Final = 4096


class Program(NamedTuple):
    """What is started.

    Attributes:
        name: Of the process, and of its log.
        command: The program and its arguments.
        ready: What its log says once it does its work.
        alive: A file that it touches as long as it works, every two seconds or so.
        tells_as_service: It tells that it works as a service tells systemd (sd_notify), and the
            file is touched for it.
    """

    name: str
    command: Sequence[str]
    ready: str
    alive: Path | None = None
    tells_as_service: bool = False


class Child:
    """A process that is to run until it is stopped.

    Args:
        program: What to start.
        place: Where its log goes.
        hung_s: One that has been silent for so long is ended.
        again_s: After which one that keeps dying is tried again.
    """

    def __init__(
        self, program: Program, place: Path, hung_s: float = _HUNG_S, again_s: float = _AGAIN_S
    ) -> None:
        self.program = program
        self.log = place / f'{program.name}.log'
        self._process: subprocess.Popen[bytes] | None = None
        self._started_s = 0.0
        self._start_at_s = 0.0
        self._crashes = 0
        self._log_from = 0
        self._told: socket.socket | None = None
        self._alive_ns: int | None = None  # the time of its file, as it was seen last
        self._seen_s = 0.0  # since when it has been that
        self._hung_s = hung_s
        self._again_s = again_s

    @property
    def runs(self) -> bool:
        """Whether there is a process."""
        return self._process is not None and self._process.poll() is None

    @property
    def out_of_service(self) -> bool:
        """Whether it keeps dying, and has not lived for long since."""
        return self._crashes >= _CRASHES and not (
            self.runs and time.monotonic() - self._started_s > _STEADY_S
        )

    @property
    def pid(self) -> int:
        """Its number."""
        assert self._process is not None, 'it has been started'
        return self._process.pid

    @property
    def is_ready(self) -> bool:
        """Whether it does its work, since it was started last."""
        if not self.runs or not self.log.exists():
            return False
        with self.log.open('rb') as log:
            log.seek(self._log_from)
            return self.program.ready.encode() in log.read()

    def start(self) -> None:
        """Start it."""
        self._log_from = self.log.stat().st_size if self.log.exists() else 0
        self._started_s = time.monotonic()
        if self.program.alive is not None:
            self.program.alive.unlink(missing_ok=True)  # that of the one before
        self._process = start_owned((*self._environ(), *self.program.command), self.log)

    def look(self) -> str:
        """Start it when that is due; returns what there is to say, or nothing."""
        if self.runs:
            self.hear()
            return self._end_if_hung()
        if self._process is not None:
            return self._note_death(self._process.wait())
        if time.monotonic() < self._start_at_s:
            return ''
        self.start()
        return f'{self.program.name} is started again, as process {self.pid}'

    def hear(self) -> None:
        """Touch the file of a process that has told that it works."""
        if self._told is None or self.program.alive is None:
            return
        with suppress(BlockingIOError):
            while words := self._told.recv(_MOST_WORDS):
                if b'WATCHDOG=1' in words.splitlines():
                    self.program.alive.touch()

    def ask_to_end(self) -> None:
        """Send SIGTERM."""
        if self.runs:
            assert self._process is not None
            self._process.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL."""
        assert self._process is not None, 'it has been started'
        self._process.kill()
        self._process.wait()
        self._hear_no_more()

    def abort(self) -> None:
        """SIGABRT shows in the log where it hangs; SIGKILL ends it even where that is stopped."""
        assert self._process is not None, 'it has been started'
        self._process.send_signal(signal.SIGABRT)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_ABORT_S)
        self.kill()

    def end(self, deadline_s: float) -> bool:
        """Wait for its end, and kill it after the deadline; returns whether it ended itself."""
        if self._process is None:
            return True
        try:
            self._process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            self.abort()
            return False
        self._hear_no_more()
        return True

    def story(self) -> str:
        """The last lines of its log."""
        lines = self.log.read_text(encoding='utf-8', errors='replace').splitlines()
        return '\n'.join(f'    {line}' for line in lines[-_TAIL_LINES:])

    def _environ(self) -> Sequence[str]:
        """A command that adds what a service needs in order to tell that it works."""
        if not self.program.tells_as_service:
            return ()
        self._hear_no_more()
        # One for each start: what a process that was killed has told says nothing of the next.
        self._told = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._told.bind('')  # the kernel finds a name
        name = self._told.getsockname()[1:].decode()
        return ('env', f'NOTIFY_SOCKET=@{name}', f'WATCHDOG_USEC={int(self._hung_s * 1e6)}')

    def _hear_no_more(self) -> None:
        if self._told is not None:
            self._told.close()
            self._told = None

    def _end_if_hung(self) -> str:
        alive = self.program.alive
        if alive is None:
            return ''
        if alive.exists():
            silent_s, limit_s = self._silent_s(alive), self._hung_s
        else:
            silent_s = time.monotonic() - self._started_s
            limit_s = _BEFORE_ALIVE * self._hung_s
        if silent_s < limit_s:
            return ''
        alive.unlink(missing_ok=True)
        self.abort()
        return f'{self.program.name} has been silent for {silent_s:.0f} s'

    def _silent_s(self, alive: Path) -> float:
        """How long the time of the file has not changed; the clock that it is of may be set."""
        alive_ns, now_s = alive.stat().st_mtime_ns, time.monotonic()
        if alive_ns != self._alive_ns:
            self._alive_ns, self._seen_s = alive_ns, now_s
        return now_s - self._seen_s

    def _note_death(self, status: int) -> str:
        now_s = time.monotonic()
        self._process = None
        self._crashes = 1 if now_s - self._started_s > _STEADY_S else self._crashes + 1
        how = f'was ended by {signal.Signals(-status).name}' if status < 0 else f'ended ({status})'
        name = self.program.name
        if self._crashes >= _CRASHES:
            self._start_at_s = now_s + self._again_s
            return (
                f'{name} {how}, {self._crashes} times in a row: OUT OF SERVICE, '
                f'is tried again in {self._again_s:g} s\n{self.story()}'
            )
        wait_s = min(_LONGEST_S, _SHORTEST_S * 2 ** (self._crashes - 1))
        self._start_at_s = now_s + wait_s
        return f'{name} {how}: is started again in {wait_s:g} s'
