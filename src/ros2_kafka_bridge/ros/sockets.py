"""The UDP sockets on which DDS listens in this process."""

import contextlib
import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_FILES: Final = Path('/proc/self/fd')
_FIRST_PORT: Final = 7400  # RTPS 2.5, 9.6.2.3: of domain 0
_PORTS: Final = 250  # of a domain


def receive_buffer_bytes(domain_id: int) -> int | None:
    """How much the smallest of them holds that has come and was not read yet.

    Args:
        domain_id: The ROS domain.

    Returns:
        None where that cannot be told: not on Linux, or where DDS has ports of its own choice.
    """
    first = _FIRST_PORT + _PORTS * domain_id
    ports = range(first, first + _PORTS)
    return min((size for port, size in _udp_sockets() if port in ports), default=None)


def _udp_sockets() -> Iterator[tuple[int, int]]:
    """Port and room of each UDP socket of this process."""
    try:
        numbers = [int(file.name) for file in _FILES.iterdir()]
    except OSError:
        return
    for number in numbers:
        with contextlib.suppress(OSError):  # closed meanwhile
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                with socket.socket(fileno=os.dup(number)) as copy:
                    yield from _udp(copy)


def _udp(found: socket.socket) -> Iterator[tuple[int, int]]:
    if found.type == socket.SOCK_DGRAM and found.family in {socket.AF_INET, socket.AF_INET6}:
        yield found.getsockname()[1], found.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
