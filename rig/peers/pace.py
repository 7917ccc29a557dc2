"""When a sender's next message is due."""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, TypeVar

T = TypeVar('T')

STEP_S: Final = 0.001
"""Nobody sleeps for less."""


def paced(
    messages: Iterable[T], rate: float = 0.0, leave: Path | None = None, until: Path | None = None
) -> Iterator[T]:
    """Yield messages, each when it is its turn.

    Args:
        messages: What is to be sent.
        rate: Messages per second, 0 is no limit; who was held back makes up for it.
        leave: A file that says how many may go.
        until: A file that ends it when it is there.
    """
    due_s, allowed = time.monotonic(), 0
    for number, message in enumerate(messages):
        while leave and number >= allowed:
            allowed = int(leave.read_text())
            due_s = time.monotonic()
            time.sleep(5 * STEP_S)
        if rate:
            left_s = due_s - time.monotonic()
            if left_s > STEP_S:
                time.sleep(left_s)
            due_s += 1 / rate
        if until and until.exists():
            return
        yield message
