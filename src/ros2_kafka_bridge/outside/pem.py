"""What is wrong with a file of certificates or keys, of which OpenSSL says the same few words."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

from ros2_kafka_bridge.outside.files import UnreadableError, read_regular

PemKind = Literal['certificate', 'key', 'list of revoked certificates']

OTHER_KEY: Final = 'not the key of the certificate in ssl.certificate.location'

_LABELS: Final[dict[PemKind, bytes]] = {
    'certificate': b'CERTIFICATE',
    'key': b'PRIVATE KEY',
    'list of revoked certificates': b'X509 CRL',
}
_BEGIN: Final = re.compile(rb'-----BEGIN ([A-Z0-9 ]{1,40})-----')
_ENCRYPTED: Final = (b'-----BEGIN ENCRYPTED PRIVATE KEY-----', b'Proc-Type: 4,ENCRYPTED')
_OF_PYTHON: Final = ('ca.location', 'certificate.location', 'key.location', 'key.password')
_LIMIT_BYTES: Final = 16 * 1024 * 1024
_BINARY: Final = 0x30  # how DER begins, and PKCS#12
_WEAK: Final = {
    'key too small': 'the key of its certificate is too short: 2048 bits of RSA at least',
    'md too weak': 'its certificate is signed in a way that counts as broken (SHA-1, MD5)',
}


def pem_problem(path: Path, kind: PemKind, *, has_password: bool = True) -> str | None:
    """Say why a library finds nothing in a file; None where a look at its marks does not tell.

    Args:
        path: The file.
        kind: What is looked for in it.
        has_password: Whether there is one for a key.
    """
    try:
        content = read_regular(path, _LIMIT_BYTES)
    except UnreadableError as error:
        return str(error)
    found = _BEGIN.findall(content)
    if not found:
        return _no_pem(content)
    label = _LABELS[kind]
    if not any(it.endswith(label) for it in found):
        return f'holds no {kind}, but {_in_words(found)}'
    if kind == 'key' and not has_password and any(mark in content for mark in _ENCRYPTED):
        return 'its key is encrypted: set ssl.key.password'
    if content.count(label + b'-----') < 2 * sum(it.endswith(label) for it in found):
        return f'its {kind} is cut off: a line -----END is missing'
    return None


def _no_pem(content: bytes) -> str:
    if not content.strip():
        return 'an empty file'
    is_binary = content[0] == _BINARY
    hint = ': it may be DER or PKCS#12, of which openssl makes PEM' if is_binary else ''
    return f'no PEM file{hint}'


def weakness(said: str) -> str | None:
    """What OpenSSL finds too weak in a certificate, by its words; None where it says no such."""
    return next((text for words, text in _WEAK.items() if words in said), None)


def unread(kind: PemKind, *, has_password: bool) -> str:
    """What is wrong with a file that looks right and that OpenSSL does not read all the same."""
    if kind == 'key' and has_password:
        wrong = 'ssl.key.password is not its password, its cipher is too old, or it is damaged'
        return f'its key cannot be read: {wrong}'
    return f'its {kind} cannot be read: it is damaged'


def tls_problems(properties: Mapping[str, object]) -> dict[str, str]:
    """What is wrong with the files of a client in Python, by the names of its properties.

    OpenSSL itself reads them, and asks no terminal for a password.

    Args:
        properties: With ssl.ca.location, ssl.certificate.location, ssl.key.location and
            ssl.key.password, where the client has them; files, but for authorities.
    """
    authorities, certificate, key, password = (properties.get(f'ssl.{n}') for n in _OF_PYTHON)
    problems: dict[str, str] = {}
    if isinstance(authorities, str) and not Path(authorities).is_dir():
        problems['ssl.ca.location'] = _authorities_problem(authorities)
    if isinstance(certificate, str):
        problems['ssl.certificate.location'] = pem_problem(Path(certificate), 'certificate') or ''
        if not problems['ssl.certificate.location']:
            problems |= _pair_problem(certificate, key, password)
    return {name: text for name, text in problems.items() if text}


def _authorities_problem(file: str) -> str:
    import ssl  # noqa: PLC0415 (slow)

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(file)
    except OSError:
        return pem_problem(Path(file), 'certificate') or unread('certificate', has_password=False)
    return ''


def _pair_problem(certificate: str, key: object, password: object) -> dict[str, str]:
    import ssl  # noqa: PLC0415 (slow)

    name, file = 'ssl.key.location' if key else 'ssl.certificate.location', str(key or certificate)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if problem := pem_problem(Path(file), 'key', has_password=bool(password)):
        where = '' if key else ': name its file in ssl.key.location'
        return {name: problem + where if problem.startswith('holds no') else problem}
    try:
        context.load_cert_chain(certificate, file, str(password or ''))
    except (OSError, ValueError) as error:
        if weak := weakness(str(error)):
            return {'ssl.certificate.location': weak}
        # Of a key of another kind (RSA, EC) it says that no certificate is assigned.
        is_other = 'mismatch' in str(error) or 'no certificate assigned' in str(error)
        return {name: OTHER_KEY if is_other else unread('key', has_password=bool(password))}
    return {}


def _in_words(labels: list[bytes]) -> str:
    words = (next((k for k, it in _LABELS.items() if one.endswith(it)), '') for one in labels)
    known = [f'a {kind}' for kind in dict.fromkeys(words) if kind]
    return ' and '.join(known) or 'something else'
