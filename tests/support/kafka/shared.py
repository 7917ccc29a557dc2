"""One real Kafka for all tests of a run that leave it running.

With pytest-xdist it belongs to the controller, which starts it for the first worker that asks.
"""

import contextlib
from collections.abc import Iterator
from multiprocessing.connection import Client, Listener
from pathlib import Path
from threading import Thread
from typing import Any, Final, NamedTuple

import pytest

from ros2_kafka_bridge.testing.local_kafka import LocalKafka


class SharedKafka(NamedTuple):
    """Where the Kafka is that all tests of a run share.

    Args:
        bootstrap_servers: Where clients find it.
        directory: Where it keeps data, configuration and log.
    """

    bootstrap_servers: str
    directory: Path

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.bootstrap_servers.rpartition(':')[2])


class Desk:
    """Tells the workers where the Kafka is, one after the other."""

    def __init__(self) -> None:
        self._listener = Listener(family='AF_UNIX')
        self._kafka = LocalKafka()
        Thread(target=self._serve, name='desk', daemon=True).start()

    @property
    def address(self) -> str:
        """Where they ask."""
        return str(self._listener.address)

    def close(self) -> None:
        """End the Kafka, and with it what it keeps."""
        self._listener.close()
        self._kafka.__exit__()

    def _serve(self) -> None:
        while True:
            try:
                asker = self._listener.accept()
            except OSError:  # closed
                return
            with asker, contextlib.suppress(OSError):  # who has asked may have gone
                asker.send(self._answer())

    def _answer(self) -> SharedKafka | str:
        try:
            if not self._kafka.is_running:
                self._kafka.start()
        except Exception as error:  # noqa: BLE001 (whoever has asked waits for an answer)
            return f'Kafka could not be started: {error}'
        return SharedKafka(self._kafka.bootstrap_servers, self._kafka.directory)


_desk: Final = pytest.StashKey[Desk]()


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a worker where to ask (pytest-xdist calls this in the controller)."""
    if _desk not in node.config.stash:
        node.config.stash[_desk] = desk = Desk()
        node.config.add_cleanup(desk.close)
    node.workerinput['kafka'] = node.config.stash[_desk].address


@pytest.fixture(scope='session')
def kafka(pytestconfig: pytest.Config) -> Iterator[SharedKafka]:
    """The Kafka that is left running."""
    worker = getattr(pytestconfig, 'workerinput', None)
    if worker is None:
        with LocalKafka() as node:
            yield SharedKafka(node.bootstrap_servers, node.directory)
        return
    with Client(worker['kafka'], family='AF_UNIX') as desk:
        found = desk.recv()
    assert isinstance(found, SharedKafka), found
    yield found
