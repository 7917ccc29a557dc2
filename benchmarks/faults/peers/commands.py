"""What a peer is told, by a file that lines are added to; and when its next order is due."""

import time
from pathlib import Path
from typing import Final

_LATEST_S: Final = 0.2


class Commands:
    """The commands that are added to a file from now on."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._place = file.stat().st_size if file.exists() else 0

    def __call__(self) -> list[list[str]]:
        """Those that have come since, as words."""
        if not self._file.exists() or self._file.stat().st_size == self._place:
            return []
        with self._file.open('rb') as file:
            file.seek(self._place)
            data = file.read()
        whole = data[: data.rfind(b'\n') + 1]
        self._place += len(whole)
        return [line.split() for line in whole.decode().splitlines()]


class Pace:
    """A rate that is not made up for: who was held back goes on at the same rate."""

    def __init__(self, rate: float) -> None:
        self._period_s = 1 / rate
        self._due_s = time.monotonic()

    def wait(self) -> None:
        """Wait until the next order is due."""
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = max(self._due_s + self._period_s, time.monotonic() - _LATEST_S)
