"""Why a request to Kafka has failed: the client knows more of it than the request."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from confluent_kafka import KafkaError

from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.kafka.errors import Client, explain, translate

if TYPE_CHECKING:
    from collections.abc import Mapping

NO_ANSWER: Final = 'the broker does not answer'
"""How the error of a cluster begins of which nothing else is known."""

_LOGIN: Final = frozenset(
    {KafkaError._AUTHENTICATION, KafkaError.SASL_AUTHENTICATION_FAILED}  # noqa: SLF001 (its public name)
)


class ClientErrors:
    """The first error of a client that names its cause, or else the first of all.

    Args:
        properties: Of the client.
        right: The operation on the topic that it needs.
    """

    def __init__(self, properties: Mapping[str, object], right: str = '') -> None:
        about = Client(properties=properties)
        self.client = about._replace(right=right) if right else about
        self.error: KafkaError | None = None

    def note(self, error: KafkaError) -> None:
        """Take an error of the client (librdkafka's error callback)."""
        if self.error is None or explain(error, self.client).names_cause:
            self.error = error

    def translated(self, error: KafkaError, where: str = '') -> BridgeError:
        """Make the bridge's error of one of a request.

        Args:
            error: Where it means to wait, what the client has said is the cause of that.
            where: Names topic or client; empty for the cluster as a whole.
        """
        kind = explain(error, self.client).kind
        if issubclass(kind, TransportError) and self.error is not None:
            error, kind = self.error, explain(self.error, self.client).kind
        return translate(error, where or _of_cluster(error, kind), self.client)


def _of_cluster(error: KafkaError, kind: type[BridgeError]) -> str:
    """What has become of a request: the cluster may have answered, and not as one likes."""
    waits = issubclass(kind, TransportError)
    if error.code() in _LOGIN:
        return 'no login to Kafka' if waits else 'Kafka refuses the login'
    if error.code() > 0 and not waits:
        return 'Kafka refuses'
    return NO_ANSWER if waits and 'SSL' not in error.str() else 'no connection to Kafka'
