"""A Kafka broker inside this process, for demonstrations and quick tests."""

import logging
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Self

from confluent_kafka import KafkaException, Producer

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.lines import client_log

__all__ = ['QUICK_FETCH', 'EmbeddedBroker']

ANSWER_S: Final = 5.0

QUICK_FETCH: Final[Mapping[str, str]] = MappingProxyType({'fetch.wait.max.ms': '10'})
"""Properties of a consumer that is not to wait for its records.

The mock answers a fetch that finds nothing when all of its time has passed, not when the next
record comes: with the default of 500 ms records would come in heaps, up to half a second late.
"""


class EmbeddedBroker:
    """librdkafka's mock cluster; clients of any process on this machine can join it.

    It answers at once and needs no Java, but it is not faithful. Do not rest a claim on
    durability, transactions or crashes on it; `LocalKafka` is for those:

    - records live in memory, end with this object, and the oldest go without a retention setting;
    - read_committed readers see aborted transactions, an old transactional producer is not
      fenced, and offsets committed in a transaction are not stored;
    - share groups get nothing; there is no TLS, SASL, ACL, compaction or configuration of topics;
    - the first join of a consumer group takes about 3 s;
    - a consumer waits for `fetch.wait.max.ms` each time that it finds nothing: give it
      `QUICK_FETCH`;
    - a topic is made, with four partitions, when it is first asked for; a partition keeps its
      newest 5 MiB.

    Args:
        brokers: How many brokers the cluster has.
    """

    def __init__(self, brokers: int = 1) -> None:
        self._brokers = brokers
        self._host: Producer | None = None
        self._bootstrap_servers = ''

    @property
    def bootstrap_servers(self) -> str:
        """Where clients find the cluster, while it is open."""
        assert self._bootstrap_servers, 'the broker is not open'
        return self._bootstrap_servers

    def __enter__(self) -> Self:
        """Start the cluster.

        Raises:
            TransportError: It does not come up.
        """
        self._host = Producer(
            {'bootstrap.servers': 'embedded', 'test.mock.num.brokers': self._brokers},
            # librdkafka announces each mock cluster as a notice; its warnings still show.
            logger=client_log(__name__, logging.WARNING),
        )
        try:
            brokers = self._host.list_topics(timeout=ANSWER_S).brokers.values()
        except KafkaException as error:
            self._close()
            raise TransportError(
                f'the embedded broker does not answer: {error.args[0].str()}; '
                'is this machine very busy, may it open sockets on 127.0.0.1?'
            ) from error
        self._bootstrap_servers = ','.join(f'{broker.host}:{broker.port}' for broker in brokers)
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _close(self) -> None:
        assert self._host is not None
        self._host.close()
        self._host = None
        self._bootstrap_servers = ''
