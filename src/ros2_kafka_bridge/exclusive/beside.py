"""Runs a route in a thread of its own, while another looks after the right to run it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from ros2_kafka_bridge.threads.stop import Stop

LOOK_S: Final = 0.1
"""How long the lock may go without a look."""


class Beside:
    """What runs in another thread, and its stop.

    Args:
        run: Runs until its stop is asked for.
        whole: The stop of the route, whose wakeup that one shares.
        name: Of the thread.
    """

    def __init__(self, run: Callable[[Stop], None], whole: Stop, name: str) -> None:
        self.stop = Stop(whole.wakeup)
        self.thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._work = run
        self._whole = whole
        self._error: BaseException | None = None

    def _run(self) -> None:
        try:
            self._work(self.stop)
        except BaseException as error:  # noqa: BLE001 (raised in the other thread)
            self._error = error

    def has_ended(self) -> bool:
        """Wait for its end, for a moment; tells whether it has come."""
        self.thread.join(LOOK_S)
        return not self.thread.is_alive()

    def end(self, *, limited: bool) -> None:
        """Let it drain, and end as the route is asked to.

        Args:
            limited: Whether the drain has a limit also while nothing is asked of the route.
        """
        if not self.stop.asked:
            self.stop.ask(limited=limited)
        if self._whole.asked and not self.stop.is_limited:
            self.stop.ask()
        if self._whole.at_once and not self.stop.at_once:
            self.stop.ask()

    def raise_error(self) -> None:
        """Raise what has ended it, if that was an error."""
        error, self._error = self._error, None  # an error holds this, by its frames
        try:
            if error is not None:
                raise error
        finally:
            del error


@contextmanager
def beside(run: Callable[[Stop], None], whole: Stop, name: str) -> Iterator[Beside]:
    """Run something in another thread; what it raises is raised here, once it has ended.

    Args:
        run: Runs until its stop is asked for.
        whole: The stop of the route, whose wakeup that one shares.
        name: Of the thread.
    """
    work = Beside(run, whole, name)
    work.thread.start()
    try:
        yield work
    finally:
        while not work.has_ended():  # a bug: it would run on with nobody to stop it
            work.end(limited=True)
    work.raise_error()
