"""The topics of a demonstration: made before, gone afterwards."""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any, Final

from confluent_kafka import KafkaError, KafkaException
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    NewTopic,
)

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.lines import client_log

_REQUEST_S: Final = 5.0
_AGAIN_S: Final = 0.5
_GONE: Final = frozenset({KafkaError.UNKNOWN_TOPIC_OR_PART, KafkaError.GROUP_ID_NOT_FOUND})


class Topics:
    """Topics on a broker that somebody else uses, too."""

    def __init__(self, bootstrap_servers: str) -> None:
        self._servers = bootstrap_servers
        self._admin = AdminClient(
            {'bootstrap.servers': bootstrap_servers}, logger=client_log(__name__)
        )

    def greet(self) -> None:
        """See that a broker is there.

        Raises:
            TransportError: None answers.
        """
        try:
            self._admin.list_topics(timeout=_REQUEST_S)
        except KafkaException as error:
            raise TransportError(
                f'no broker answers at {self._servers} ({error.args[0].str()}): '
                'is --bootstrap-servers right, does the broker run? The demo has no TLS and no '
                'login'
            ) from error

    def look_up(self, names: Sequence[str]) -> None:
        """Ask for topics; the embedded broker makes them when they are asked for."""
        for name in names:
            self._admin.list_topics(name, timeout=_REQUEST_S)

    def create(self, names: Sequence[str]) -> None:
        """Create topics of one partition.

        Raises:
            TransportError: The broker does not answer, or refuses.
        """
        new = [NewTopic(name, num_partitions=1) for name in names]
        for name, answer in self._admin.create_topics(new, request_timeout=_REQUEST_S).items():
            if error := answer.exception():
                why = error.args[0].str()
                raise TransportError(f'topic {name} cannot be created: {why}') from error

    def delete(self, names: Sequence[str], groups: Sequence[str], patience_s: float) -> str:
        """Delete topics and groups that may be there; returns what has failed, or nothing.

        Args:
            names: The topics.
            groups: The consumer groups.
            patience_s: How long to wait for the broker to forget a member that was killed.
        """
        limit = {'request_timeout': _REQUEST_S}
        failed = _failed(self._admin.delete_topics(list(names), **limit))
        deadline_s = time.monotonic() + patience_s
        while True:
            left = _failed(self._admin.delete_consumer_groups(list(groups), **limit))
            if not left or time.monotonic() > deadline_s:
                break
            time.sleep(_AGAIN_S)
        return '; '.join(f'{name} is left: {why}' for name, why in {**failed, **left}.items())


def _failed(answers: Mapping[str, Future[Any]]) -> dict[str, str]:
    raised = ((name, answer.exception()) for name, answer in answers.items())
    errors = {name: error.args[0] for name, error in raised if error}
    return {name: error.str() for name, error in errors.items() if error.code() not in _GONE}
