"""Why a broker's certificate is not trusted: librdkafka says the same words for every reason."""

import re
import socket
import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.properties import file_fault

_PATIENCE_S: Final = 10.0
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

    librdkafka says it worse, waits for a pipe and, where it asks for tokens, ends the process.

    Raises:
        RouteError: One of them cannot be read; it says which.
    """
    for name, value in properties.items():
        if problem := file_fault(name, str(value)):
            raise RouteError(f'{where}: {name}: {problem}')


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
