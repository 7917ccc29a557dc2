"""Why a broker's certificate is not trusted: librdkafka says the same words for every reason."""

import re
import socket
import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import RouteError

_PATIENCE_S: Final = 10.0
_FILES: Final = (
    'ssl.ca.location',
    'ssl.certificate.location',
    'ssl.key.location',
    'ssl.keystore.location',
    'ssl.crl.location',
    'https.ca.location',
)
_ADDRESS = re.compile(r'\b(?:sasl_)?ssl://(?P<host>\[[^]]+\]|[^:/\s]+):(?P<port>\d+)')


class BrokerAddress(NamedTuple):
    """Where a TLS listener of a broker is."""

    host: str
    port: int


def address_in(text: str) -> BrokerAddress | None:
    """The TLS listener that an error of librdkafka speaks of, None where it names none."""
    found = _ADDRESS.search(text)
    return found and BrokerAddress(found['host'].strip('[]'), int(found['port']))


def distrust(address: BrokerAddress, properties: Mapping[str, Any]) -> str:
    """Shake hands with a broker, as its client would, and say why it is not trusted.

    Waits for at most ten seconds to connect, and as long for the handshake.

    Args:
        address: A TLS listener.
        properties: librdkafka properties of a client.

    Returns:
        OpenSSL's reason; empty where the broker is trusted, or the question has no answer.
    """
    try:
        context = _context(properties)
        with (
            socket.create_connection(address, _PATIENCE_S) as connection,
            context.wrap_socket(connection, server_hostname=address.host),
        ):
            return ''
    except ssl.SSLCertVerificationError as error:
        return str(error.verify_message).rstrip('.')
    except (OSError, ValueError):
        return ''


def check_files(properties: Mapping[str, Any], where: str) -> None:
    """Look for the files that a client will read.

    librdkafka says it worse and, where it asks for tokens, ends the process for it.

    Raises:
        RouteError: One of them cannot be read; it says which.
    """
    if problem := _unreadable(properties):
        raise RouteError(f'{where}: {problem}')


def _unreadable(properties: Mapping[str, Any]) -> str:
    """What is wrong with the files that properties name; empty where nothing is."""
    for name in _FILES:
        value = str(properties.get(name, 'probe'))
        if value == 'probe' or Path(value).is_dir():
            continue
        try:
            Path(value).open('rb').close()
        except OSError as error:
            return f'{name}: {value}: {error.strerror}'
    return ''


def _context(properties: Mapping[str, Any]) -> ssl.SSLContext:
    authorities: dict[str, Any] = {}
    location = str(properties.get('ssl.ca.location', 'probe'))
    if 'ssl.ca.pem' in properties:
        authorities['cadata'] = str(properties['ssl.ca.pem'])
    elif location != 'probe':
        authorities['capath' if Path(location).is_dir() else 'cafile'] = location
    context = ssl.create_default_context(**authorities)
    wanted = str(properties.get('ssl.endpoint.identification.algorithm', 'https'))
    context.check_hostname = wanted.lower() != 'none'
    return context
