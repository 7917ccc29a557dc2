"""Which file of certificates or keys librdkafka refuses, and why, in words of its owner."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.outside.files import holds_text
from ros2_kafka_bridge.outside.pem import OTHER_KEY, PemKind, pem_problem, unread, weakness

_KINDS: Final[dict[str, PemKind]] = {
    'ssl.ca.location': 'certificate',
    'ssl.certificate.location': 'certificate',
    'ssl.key.location': 'key',
    'ssl.crl.location': 'list of revoked certificates',
}
_STORE: Final = 'ssl.keystore.location'
_NAMED: Final = re.compile(rf'({"|".join(map(re.escape, _KINDS))}) failed')
_OTHER: Final = f'{OTHER_KEY} (or ssl.certificate.pem)'
_LONELY: Final = re.compile('private key check failed.*no certificate', re.IGNORECASE)


class RefusedFile(NamedTuple):
    """The property that names a file, and what is wrong with this."""

    name: str
    problem: str


def refused_file(error: str, properties: Mapping[str, Any]) -> RefusedFile | None:
    """Say which file librdkafka refuses, and why; None where it speaks of something else.

    Args:
        error: What it says of a client that it does not make.
        properties: Of the client.
    """
    if _LONELY.search(error):
        return _of_lonely_key(properties)
    if found := _NAMED.search(error):
        name = found[1]
        problem = _problem(name, error, properties)
    elif _STORE in error and 'PKCS#12' in error:
        name = _STORE
        problem = _store_problem(error)
    else:
        return None
    return _of_file(name, problem, properties)


def _of_file(name: str, problem: str, properties: Mapping[str, Any]) -> RefusedFile | None:
    path = str(properties.get(name, ''))
    shown = problem if holds_text(path) else f'{path}: {problem}'
    return RefusedFile(name, shown) if path else None


def _of_lonely_key(properties: Mapping[str, Any]) -> RefusedFile | None:
    names = [name for name in ('ssl.key.location', 'ssl.key.pem') if properties.get(name)]
    needs = 'needs its certificate, too: ssl.certificate.location, or ssl.certificate.pem'
    # A certificate of another kind of key (RSA, EC) counts as none.
    has_one = any(properties.get(f'ssl.certificate.{name}') for name in ('location', 'pem'))
    if names and has_one:
        return _of_file(names[0], _OTHER, properties)
    return RefusedFile(names[0], needs) if names else None


def _problem(name: str, error: str, properties: Mapping[str, Any]) -> str:
    if 'key values mismatch' in error:
        return _OTHER
    if weak := weakness(error):
        return weak
    kind, has_password = _KINDS[name], bool(properties.get('ssl.key.password'))
    found = pem_problem(Path(str(properties.get(name))), kind, has_password=has_password)
    return found or unread(kind, has_password=has_password)


def _store_problem(error: str) -> str:
    if 'mac verify failure' in error:
        return 'cannot be opened: ssl.keystore.password is not its password, or it is damaged'
    if 'unsupported' in error:
        return 'locked with an old cipher that OpenSSL 3 takes no more: export it anew'
    return 'no PKCS#12 file that can be read'
