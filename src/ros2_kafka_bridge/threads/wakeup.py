"""How the wait of a thread is ended by another, or by the handler of a signal."""

import contextlib
import math
import os
import select
import weakref

_MS_PER_S = 1000


class Wakeup:
    """Rung by anybody, waited for by one thread; rung once or often is the same.

    It is an eventfd, so a thread can wait for it and for others at once. It is closed with the
    last reference to it: who rings has one, and writes to no other file by mistake.
    """

    def __init__(self) -> None:
        self.is_rung = False
        self.descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._close = weakref.finalize(self, os.close, self.descriptor)
        self._close.atexit = False  # it may be rung until the very end

    def ring(self) -> None:
        """End a wait, this one or the next; takes no lock."""
        self.is_rung = True
        os.eventfd_write(self.descriptor, 1)

    def clear(self) -> None:
        """Forget that it was rung; before looking at what that was for."""
        self.is_rung = False
        with contextlib.suppress(BlockingIOError):  # it was not
            os.eventfd_read(self.descriptor)

    def keep_open(self) -> None:
        """Never close it: somebody who cannot be told otherwise may write to it for ever."""
        self._close.detach()

    def wait(self, timeout_s: float) -> bool:
        """Wait until it is rung; tells whether it was."""
        poll = select.poll()  # of this wait: two threads cannot share one
        poll.register(self.descriptor, select.POLLIN)
        return bool(poll.poll(math.ceil(timeout_s * _MS_PER_S)))
