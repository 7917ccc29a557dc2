"""How long a process lives: to the end of its test, and as far as the test lets it go."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import AnyStr

from support.patience import eventually, patient

from rig.processes import KILLED_S


@contextmanager
def ended(process: Popen[AnyStr]) -> Iterator[Popen[AnyStr]]:
    """Kill a process at the end of `with`, and close its pipes."""
    try:
        yield process
    finally:
        process.kill()
        process.wait(patient(KILLED_S))
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


class Leave:
    """How many messages a publisher may publish, or a subscriber take (`--leave FILE`).

    Args:
        place: Where its files go.
        name: Of its files, where a test has two.
    """

    def __init__(self, place: Path, name: str = 'leave') -> None:
        place.mkdir(parents=True, exist_ok=True)
        self._file = place / name
        self._out = self._file.with_suffix('.out')
        self.options = ('--leave', str(self._file))
        self.up_to(0)

    def up_to(self, count: int) -> None:
        """Let it go on until it has done so many."""
        new = self._file.with_suffix('.new')
        new.write_text(str(count))
        new.replace(self._file)

    def set_off(self, count: int) -> None:
        """Let a publisher go on until it has published so many, and see that it does."""
        before = self.out
        self.up_to(count)
        eventually(lambda: self.out > before, 60)

    @property
    def out(self) -> int:
        """How many a publisher has published."""
        return self._out.stat().st_size if self._out.exists() else 0
