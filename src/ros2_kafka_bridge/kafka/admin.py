"""The client that asks a cluster about itself, with errors that say why it does not answer."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from confluent_kafka import KafkaError, KafkaException
from confluent_kafka.admin import AdminClient

from ros2_kafka_bridge.errors import BridgeError, TransportError
from ros2_kafka_bridge.kafka.errors import Client, explain, translate
from ros2_kafka_bridge.kafka.tls import check_files


class _Cause:
    """The first error of a client that names its cause, or else the first of all."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.error: KafkaError | None = None

    def note(self, error: KafkaError) -> None:
        if self.error is None or explain(error, self.client).names_cause:
            self.error = error


class Admin:
    """An AdminClient; a request that fails for want of a connection says why there is none.

    Raises:
        RouteError: librdkafka refuses the properties, or what is in their files.
    """

    def __init__(self, properties: Mapping[str, Any], name: str) -> None:
        check_files(properties, 'the Kafka client')
        # The client must not hold this object, which holds the client: such a circle ends in the
        # garbage collector, which takes the callback away from a client that still calls it.
        self._cause = _Cause(Client(properties=properties))
        own: dict[str, Any] = {'error_cb': self._cause.note}
        try:
            self.requests = AdminClient(
                {**properties, **own},
                logger=logging.getLogger(f'{name}.librdkafka'),
            )
        except KafkaException as error:  # a file that is half written, perhaps
            raise translate(error.args[0], 'the Kafka client', self._cause.client) from error

    @contextmanager
    def translated(self, where: str) -> Iterator[None]:
        """Make the bridge's errors of those that a request raises."""
        try:
            yield
        except KafkaException as error:
            self.requests.poll(0)  # calls back what has come meanwhile
            raise self._translate(error.args[0], where) from error
        # That may have been at an address which the cluster names: none is blamed from now on.
        self._cause.client = self._cause.client._replace(is_reached=True)

    def _translate(self, error: KafkaError, where: str) -> BridgeError:
        problem = translate(error, where, self._cause.client)
        if isinstance(problem, TransportError) and self._cause.error is not None:
            return translate(self._cause.error, where, self._cause.client)
        return problem
