"""How a worker ends that cannot begin."""

from typing import NoReturn

import pytest

from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError, TransportError
from ros2_kafka_bridge.process import worker


@pytest.mark.parametrize(
    ('error', 'status'),
    [
        (ConfigError(['it is wrong']), 2),
        (RouteError('it is not here'), 2),
        (TransportError('it is full'), 1),
    ],
)
def test_what_goes_by_itself_is_tried_again(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: BridgeError,
    status: int,
) -> None:
    """Status 2 is what a service manager takes for an end."""

    def run(*_: object) -> NoReturn:
        raise error

    monkeypatch.setattr(worker, '_before_the_start', lambda _: None)
    monkeypatch.setattr(worker, '_run', run)
    assert worker.main(['--plan', '0', 'bridge.yaml']) == status
    assert capfd.readouterr().err == f'{error}\n'
