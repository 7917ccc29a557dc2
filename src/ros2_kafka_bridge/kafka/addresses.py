"""Addresses of brokers: as bootstrap.servers lists them, and as an error of a client names one."""

import ipaddress
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from ros2_kafka_bridge.outside.masking import masked_addresses

_ENTRY: Final = re.compile(
    r'(?:(?P<protocol>[^:/]+)://)?(?P<host>\[[^\]]*\]|[^:/]*)(?::(?P<port>[^:/]*))?(?:/[^:]*)?'
)
_ODD: Final = re.compile(r'[\s;@\'"\[\]]')
_NAMED: Final = re.compile(
    r'(?P<coordinator>GroupCoordinator: )?(?:\w+://)?(?P<address>\S+:\d+)(?:/(?P<id>\w+))?: '
)
_PROTOCOLS: Final = frozenset({'plaintext', 'ssl', 'sasl_plaintext', 'sasl_ssl'})
_PORT: Final = '9092'
_MOST_PORTS: Final = 65535


class NamedBroker(NamedTuple):
    """A broker that an error is about.

    Args:
        address: `host:port`.
        is_learned: Whether the cluster has named it, and not bootstrap.servers.
    """

    address: str
    is_learned: bool


def broker_in(text: str) -> NamedBroker | None:
    """The broker that an error of librdkafka is about; None where it names none."""
    found = _NAMED.match(text)
    if found is None:
        return None
    is_learned = bool(found['coordinator']) or (found['id'] or '').isdigit()
    return NamedBroker(found['address'].lower(), is_learned)


def listed(servers: str) -> set[str]:
    """The addresses in bootstrap.servers, as librdkafka takes them."""
    found = (_ENTRY.fullmatch(entry) for entry in _entries(servers))
    return {f'{it["host"]}:{it["port"] or _PORT}'.lower() for it in found if it}


def servers_problem(servers: str, protocol: str | None = None) -> str:
    """What is wrong with a list of brokers; empty if nothing is.

    librdkafka takes any text. Of what it cannot read it makes no broker at all, one on port 0, or
    one that nobody can find, and says so where nobody looks.

    Args:
        servers: The value of bootstrap.servers.
        protocol: That of security.protocol; None where it is not known.
    """
    entries = list(_entries(servers))
    if not entries:
        return 'names no broker: write host:port, such as localhost:9092'
    if '@' in servers:  # nothing of it is said: a password may hold a comma
        return (
            'is no host:port, separated by commas: a user and a password, before @, belong in '
            'sasl.username and sasl.password'
        )
    return masked_addresses(next(filter(None, (_problem(e, protocol) for e in entries)), ''))


def _entries(servers: str) -> Iterator[str]:
    return filter(None, map(str.strip, servers.split(',')))


def _problem(entry: str, protocol: str | None) -> str:
    if _is_ipv6(entry.rpartition('://')[2]):
        return ''  # an address of IPv6 may stand alone, without a port
    found = _ENTRY.fullmatch(entry)
    if found is None or _ODD.search(found['host'].removeprefix('[').removesuffix(']')):
        return f"'{entry}' is no host:port, separated by commas"
    return _problem_of_parts(found, protocol)


def _problem_of_parts(found: re.Match[str], protocol: str | None) -> str:
    entry, said, port = found[0], found['protocol'], found['port']
    if not found['host'] and port is None:
        return f"'{entry}' names no host"
    if said is not None and said.lower() not in _PROTOCOLS:
        return f"'{entry}' begins with {said}://, and Kafka speaks no {said}: write host:port"
    if said is not None and protocol is not None and said.lower() != protocol.lower():
        return f"'{entry}' says {said}, and security.protocol is {protocol}"
    if port is not None and not (_is_number(port) and 0 < int(port) <= _MOST_PORTS):
        return f"'{entry}' has no port from 1 to {_MOST_PORTS}"
    return ''


def _is_number(text: str) -> bool:
    return text.isascii() and text.strip().isdecimal()


def _is_ipv6(text: str) -> bool:
    try:
        ipaddress.IPv6Address(text)
    except ValueError:
        return False
    return True
