"""What the tests of formats share."""

from collections.abc import Iterator

import pytest
import trustme
from support.registry.server import RegistryServer


@pytest.fixture(autouse=True, scope='module')
def _one_authority(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Trust one authority instead of all of the web, which each client of a registry reads.

    That takes 0.08 s of CPU time, and hundreds of tests open clients, all of them without TLS.
    """
    place = tmp_path_factory.mktemp('authorities')
    trustme.CA().cert_pem.write_to_path(str(place / 'one.pem'))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('SSL_CERT_FILE', str(place / 'one.pem'))
        yield


@pytest.fixture
def server(registry: RegistryServer) -> RegistryServer:
    return registry
