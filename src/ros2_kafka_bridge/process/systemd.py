"""What a service tells systemd (sd_notify): that it is ready, reloads, stops, and lives."""

import os
import socket
import time
from collections.abc import MutableMapping
from typing import Final

_ADDRESS: Final = 'NOTIFY_SOCKET'
_PERIOD_USEC: Final = 'WATCHDOG_USEC'
_PID: Final = 'WATCHDOG_PID'
_STATUS_S: Final = 10.0


class Systemd:
    """The service manager that has started this process, or nobody.

    Args:
        address: Of its socket; empty where there is none.
        watchdog_s: How long it waits for a sign of life; None where it waits for none.
    """

    def __init__(self, address: str = '', watchdog_s: float | None = None) -> None:
        self._address = address
        self._watchdog_s = watchdog_s
        self._alive_at_s = 0.0
        self._is_ready = self._is_stopping = False
        self._owed: list[str] = []  # what its queue had no room for: said in this order
        self._said = ''
        self._say_at_s = 0.0

    @property
    def listens(self) -> bool:
        """Whether anybody does."""
        return bool(self._address)

    @classmethod
    def from_environ(cls, environ: MutableMapping[str, str]) -> 'Systemd':
        """Take it out of the environment: what this process starts does not speak for it."""
        address = environ.pop(_ADDRESS, '')
        period, pid = environ.pop(_PERIOD_USEC, ''), environ.pop(_PID, '')
        mine = not pid or pid == str(os.getpid())
        watchdog_s = int(period) / 1e6 if period.isdigit() and int(period) and mine else None
        return cls(address, watchdog_s)

    def ready(self, text: str) -> None:
        """Tell that the start, or a reload, is over; once for each of them."""
        if not self._is_ready:
            self._is_ready = True
            self._owe([*self._owed, f'READY=1\nSTATUS={text}'])

    def status(self, text: str) -> None:
        """Tell how it is doing, if that has changed, but not all the time."""
        now_s = time.monotonic()
        if text != self._said and now_s >= self._say_at_s and self._tell(f'STATUS={text}'):
            self._say_at_s = now_s + _STATUS_S
            self._said = text

    def reloading(self) -> None:
        """Tell that a reload begins; `ready` is to follow. One that stops reloads no more."""
        if not self._is_stopping:
            self._is_ready = False
            now_usec = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
            self._owe([f'RELOADING=1\nMONOTONIC_USEC={now_usec}\nSTATUS=reloading'])

    def stopping(self) -> None:
        """Tell that it drains and ends; once."""
        if not self._is_stopping:
            self._is_stopping = True
            self._owe(['STOPPING=1\nSTATUS=draining'])

    def alive(self) -> None:
        """Give a sign of life, as often as is needed."""
        now_s = time.monotonic()
        if self._watchdog_s is None or now_s < self._alive_at_s:
            return
        if self._tell('WATCHDOG=1'):
            self._alive_at_s = now_s + self._watchdog_s / 2 - 0.1

    def tick(self) -> None:
        """Tell again what there was no room for."""
        while self._owed and self._tell(self._owed[0]):
            del self._owed[0]

    def _owe(self, owed: list[str]) -> None:
        self._owed = owed
        self.tick()

    def _tell(self, text: str) -> bool:
        """Whether it was taken: who is busy or gone does not hold the routes up."""
        if not self._address:
            return True
        name = self._address
        where = f'\0{name[1:]}' if name.startswith('@') else name
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
                end.setblocking(False)  # noqa: FBT003 (the standard library's)
                end.sendto(text.encode(), where)
        except OSError:
            return False
        return True
