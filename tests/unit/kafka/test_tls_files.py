"""A file of certificates or keys that is refused is named, and what is wrong with it."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import trustme
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import pkcs12

from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.formats.registry import open_registry
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.kafka.tls_files import refused_file
from ros2_kafka_bridge.outside.pem import tls_problems

CA, CERTIFICATE, KEY = 'ssl.ca.location', 'ssl.certificate.location', 'ssl.key.location'
STORE, CRL = 'ssl.keystore.location', 'ssl.crl.location'
PASSWORD = 'right-4711'  # noqa: S105 (of a test)
LOCKED = (
    'its key cannot be read: ssl.key.password is not its password, its cipher is too old, '
    'or it is damaged'
)
SHORT = 'the key of its certificate is too short: 2048 bits of RSA at least'
OTHER = 'not the key of the certificate in ssl.certificate.location'
CUT = 'its certificate is cut off: a line -----END is missing'
BINARY = 'no PEM file: it may be DER or PKCS#12, of which openssl makes PEM'


def weak(key: rsa.RSAPrivateKey) -> x509.Certificate:
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, 'weak')])
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    return (
        x509.CertificateBuilder(name, name, key.public_key(), 1, begin, begin + timedelta(9999))
    ).sign(key, hashes.SHA256())


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('files')
    authority = trustme.CA()
    made, other = authority.issue_cert('a.example.org'), authority.issue_cert('b.example.org')
    certificate = made.cert_chain_pems[0].bytes()
    key = serialization.load_pem_private_key(made.private_key_pem.bytes(), None)
    hidden = serialization.BestAvailableEncryption(PASSWORD.encode())
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    parsed = x509.load_pem_x509_certificate(certificate)
    short = rsa.generate_private_key(65537, 1024)  # noqa: S505 (to be refused)
    whole = authority.cert_pem.bytes()
    files = {
        'ca.pem': whole,
        'a.crt': certificate,
        'a.key': made.private_key_pem.bytes(),
        'b.key': other.private_key_pem.bytes(),
        'weak.key': short.private_bytes(pem, pkcs8, serialization.NoEncryption()),
        'weak.crt': weak(short).public_bytes(pem),
        'locked.key': key.private_bytes(pem, pkcs8, hidden),
        'empty': b'',
        'text': b'hello\n',
        'der': parsed.public_bytes(serialization.Encoding.DER),
        'cut': whole[:300],
        'damaged': whole.replace(b'MII', b'MIJ', 1),
        'store': pkcs12.serialize_key_and_certificates(
            b'a',
            key,  # type: ignore[arg-type]  # of an elliptic curve
            parsed,
            None,
            hidden,
        ),
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def placed(place: Path, properties: dict[str, str]) -> dict[str, str]:
    files = {name for name in properties if name.endswith('.location')}
    return {n: str(place / v) if n in files else v for n, v in properties.items()}


WRONG: list[tuple[dict[str, str], str, str]] = [
    ({CA: 'gone'}, CA, 'no such file'),
    ({CA: 'empty'}, CA, 'an empty file'),
    ({CA: 'text'}, CA, 'no PEM file'),
    ({CA: 'a.key'}, CA, 'holds no certificate, but a key'),
    ({CA: 'der'}, CA, BINARY),
    ({CA: 'cut'}, CA, CUT),
    ({CA: 'damaged'}, CA, 'its certificate cannot be read: it is damaged'),
    ({CERTIFICATE: 'gone', KEY: 'a.key'}, CERTIFICATE, 'no such file'),
    ({CERTIFICATE: 'empty', KEY: 'a.key'}, CERTIFICATE, 'an empty file'),
    ({CERTIFICATE: 'a.key', KEY: 'a.key'}, CERTIFICATE, 'holds no certificate, but a key'),
    ({CERTIFICATE: 'cut', KEY: 'a.key'}, CERTIFICATE, CUT),
    ({CERTIFICATE: 'a.crt', KEY: 'empty'}, KEY, 'an empty file'),
    ({CERTIFICATE: 'a.crt', KEY: 'a.crt'}, KEY, 'holds no key, but a certificate'),
    ({CERTIFICATE: 'a.crt', KEY: 'b.key'}, KEY, OTHER),
    ({CERTIFICATE: 'a.crt', KEY: 'weak.key'}, KEY, OTHER),  # of another kind
    ({CERTIFICATE: 'weak.crt', KEY: 'weak.key'}, CERTIFICATE, SHORT),
    ({CERTIFICATE: 'a.crt', KEY: 'locked.key'}, KEY, 'its key is encrypted: set ssl.key.password'),
    ({CERTIFICATE: 'a.crt', KEY: 'locked.key', 'ssl.key.password': 'wrong'}, KEY, LOCKED),
]
OF_KAFKA: list[tuple[dict[str, str], str, str]] = [
    ({CRL: 'empty', CA: 'ca.pem'}, CRL, 'an empty file'),
    ({STORE: 'text', 'ssl.keystore.password': 'x'}, STORE, 'no PKCS#12 file that can be read'),
    ({STORE: 'store', 'ssl.keystore.password': 'x'}, STORE, 'cannot be opened: ssl.keystore.'),
]


@pytest.mark.parametrize(('properties', 'name', 'said'), WRONG + OF_KAFKA)
def test_what_the_client_of_kafka_refuses_is_named(
    place: Path, properties: dict[str, str], name: str, said: str
) -> None:
    asked = {'security.protocol': 'SSL', 'bootstrap.servers': '127.0.0.1:9'}
    found = property_problems({**asked, **placed(place, properties)})
    assert list(found) == [name]
    assert found[name].startswith(f'{place / properties[name]}: {said}')
    with pytest.raises(RouteError) as caught:
        Admin({**asked, **placed(place, properties)}, 'test')
    assert f'{name}: {place / properties[name]}: {said}' in str(caught.value)


@pytest.mark.parametrize(('properties', 'name', 'said'), WRONG)
def test_what_the_client_of_the_registry_refuses_is_named(
    place: Path, properties: dict[str, str], name: str, said: str
) -> None:
    found = tls_problems(placed(place, properties))
    assert found == {name: said}
    asked = {'url': 'https://127.0.0.1:9', **placed(place, properties)}
    with pytest.raises(ConfigError) as caught:
        open_registry(Scope('robots', registry=asked))
    assert caught.value.problems == [f'schema_registry: {name}: {said}']


@pytest.mark.parametrize(
    'properties',
    [
        {CA: 'ca.pem'},
        {CA: '.'},
        {CERTIFICATE: 'a.crt', KEY: 'a.key'},
        {CERTIFICATE: 'a.crt', KEY: 'locked.key', 'ssl.key.password': PASSWORD},
    ],
)
def test_of_right_files_nothing_is_said(place: Path, properties: dict[str, str]) -> None:
    right = placed(place, properties)
    assert property_problems({'security.protocol': 'SSL', **right}) == {}
    assert tls_problems(right) == {}


def test_a_certificate_without_its_key_says_where_to_name_that(place: Path) -> None:
    [(name, said)] = tls_problems({CERTIFICATE: str(place / 'a.crt')}).items()
    assert (name, said.split(': ')[1]) == (CERTIFICATE, 'name its file in ssl.key.location')


def test_a_key_without_its_certificate_says_what_it_needs(place: Path) -> None:
    asked = {'security.protocol': 'SSL', KEY: str(place / 'a.key')}
    [(name, said)] = property_problems(asked).items()
    assert (name, said.split(':')[0]) == (KEY, 'needs its certificate, too')


def test_a_store_with_a_cipher_of_old_is_not_said_to_be_none() -> None:
    said = (
        'Failed to create producer: Error reading ssl.keystore.location PKCS#12 file: '
        'error:0308010C:digital envelope routines::unsupported: Algorithm (RC2-40-CBC : 0)'
    )
    found = refused_file(said, {STORE: '/etc/a.p12'})
    assert found is not None
    assert 'export it anew' in found.problem
