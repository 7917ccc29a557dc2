"""Who is at the other end of a connection: an address, and the user as this kernel knows it.

The address alone does not tell the user: behind a proxy on this machine anybody comes from
127.0.0.1, with any `Host` that they like.
"""

import sys
from collections.abc import Mapping
from ipaddress import IPv6Address, IPv6Network, ip_address
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.logs.text import printable

_TABLES: Final = {4: Path('/proc/self/net/tcp'), 16: Path('/proc/self/net/tcp6')}
_ESTABLISHED: Final = '01'
RIGHT_SHOWN: Final = 'ros2_kafka_bridge.token_shown'
"""Where the scope of a request tells that the right token has come with it."""


class SocketAddress(NamedTuple):
    """One end of a connection."""

    host: str
    port: int


def who(client: tuple[str, int] | None) -> str:
    """The address of a client, for the log."""
    return printable(client[0]) if client else 'somebody'


def has_shown_token(scope: Mapping[str, object]) -> bool:
    """Whether a request has come with the right one."""
    return bool(scope.get(RIGHT_SHOWN))


def network_of(client: tuple[str, int] | None) -> str:
    """What one client may take its addresses from: an address of IPv4, a /64 of IPv6."""
    host = client[0] if client else ''
    try:
        address = ip_address(host.partition('%')[0])
    except ValueError:
        return host
    if not isinstance(address, IPv6Address):
        return str(address)
    mapped = address.ipv4_mapped
    return str(mapped or IPv6Network((address, 64), strict=False))


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
