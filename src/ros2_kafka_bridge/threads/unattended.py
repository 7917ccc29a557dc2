"""Threads that nobody waits for: they may wait for a broker for long, or for ever."""

import threading
from collections.abc import Callable
from typing import Final

_MARK: Final = 'unattended: '


def start(name: str, target: Callable[[], object]) -> threading.Thread:
    """Begin such a thread.

    Raises:
        RuntimeError: This process may have no more threads.
    """
    thread = threading.Thread(target=target, name=f'{_MARK}{name}', daemon=True)
    thread.start()
    return thread


def ends_within(seconds: float, name: str, target: Callable[[], object]) -> bool:
    """Run something that may wait for ever; tells whether it has ended in time.

    Raises:
        RuntimeError: This process may have no more threads.
    """
    thread = start(name, target)
    thread.join(seconds)
    return not thread.is_alive()


def is_any_left() -> bool:
    """Whether one is at work: it would meet an interpreter that is being taken down."""
    return any(thread.name.startswith(_MARK) for thread in threading.enumerate())
