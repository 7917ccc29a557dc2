"""Whose program is at the other end of a connection, as the kernel of this machine knows it.

An address does not tell: behind a proxy on this machine anybody comes from 127.0.0.1, with any
`Host` that they like.
"""

import sys
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import Final, NamedTuple

_TABLES: Final = {4: Path('/proc/self/net/tcp'), 16: Path('/proc/self/net/tcp6')}
_ESTABLISHED: Final = '01'


class SocketAddress(NamedTuple):
    """One end of a connection."""

    host: str
    port: int


def user_of(caller: SocketAddress, own: SocketAddress) -> int | None:
    """The user id of the program that has opened a connection; None where it is not of here.

    Args:
        caller: Its end.
        own: Ours.
    """
    try:
        hosts = [_bytes_of(end.host) for end in (caller, own)]
        lines = _TABLES[len(hosts[0])].read_text().splitlines()[1:]
    except (ValueError, OSError):
        return None
    wanted = [_listed(hosts[0], caller.port), _listed(hosts[1], own.port), _ESTABLISHED]
    for line in lines:
        _, local, remote, state, _, _, _, user, *_ = line.split()
        if [local, remote, state] == wanted:
            return int(user)
    return None


def _bytes_of(host: str) -> bytes:
    address = ip_address(host)
    if isinstance(address, IPv6Address):
        address = address.ipv4_mapped or address
    return address.packed


def _listed(host: bytes, port: int) -> str:
    """As `proc(5)` has it: each four bytes as a number of this machine."""
    words = [host[start : start + 4] for start in range(0, len(host), 4)]
    return ''.join(f'{int.from_bytes(word, sys.byteorder):08X}' for word in words) + f':{port:04X}'
