"""The client that asks a cluster about itself, with errors that say why it does not answer."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from confluent_kafka import KafkaException
from confluent_kafka.admin import AdminClient

from ros2_kafka_bridge.kafka.cause import ClientErrors
from ros2_kafka_bridge.kafka.errors import translate
from ros2_kafka_bridge.kafka.tls import check_files


class Admin:
    """An AdminClient; a request that fails for want of a connection says why there is none.

    Raises:
        RouteError: librdkafka refuses the properties, or what is in their files.
    """

    def __init__(self, properties: Mapping[str, Any], name: str) -> None:
        check_files(properties, 'the Kafka client')
        # The client must not hold this object, which holds the client: such a circle ends in the
        # garbage collector, which takes the callback away from a client that still calls it.
        self._cause = ClientErrors(properties)
        own: dict[str, Any] = {'error_cb': self._cause.note}
        try:
            self.requests = AdminClient(
                {**properties, **own},
                logger=logging.getLogger(f'{name}.librdkafka'),
            )
        except KafkaException as error:  # a file that is half written, perhaps
            raise translate(error.args[0], 'the Kafka client', self._cause.client) from error

    @contextmanager
    def translated(self, where: str = '') -> Iterator[None]:
        """Make the bridge's errors of those that a request raises.

        Args:
            where: Names what is asked about; empty for the cluster as a whole.
        """
        try:
            yield
        except KafkaException as error:
            self.requests.poll(0)  # calls back what has come meanwhile
            raise self._cause.translated(error.args[0], where) from error
        # That may have been at an address which the cluster names: none is blamed from now on.
        self._cause.client = self._cause.client._replace(is_reached=True)
