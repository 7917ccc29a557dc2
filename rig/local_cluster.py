"""A real Apache Kafka cluster on this machine: three processes, of which any one may die."""

import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Final, NamedTuple, Self

from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    NewTopic,
    PartitionMetadata,
)

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.testing.kafka_node import (
    HOST,
    PROPERTIES,
    START_S,
    Asking,
    KafkaNode,
    PortLostError,
    free_port,
    new_id,
    replication,
    wait_for_brokers,
)
from ros2_kafka_bridge.testing.local_kafka import install_kafka

START_ATTEMPTS: Final = 5
REQUEST_S: Final = 30.0
PAUSE_S: Final = 0.05

JVM_FLAGS: Final = ('-Xms64m', '-Xmx256m')

CLUSTER: Final[Mapping[str, str]] = MappingProxyType(
    {
        **PROPERTIES,
        # The controller gives a silent node up after so long, and makes another one the leader.
        'broker.session.timeout.ms': '2500',
        'broker.heartbeat.interval.ms': '200',
        'controller.quorum.fetch.timeout.ms': '1500',
        'controller.quorum.election.backoff.max.ms': '300',
        'replica.fetch.backoff.ms': '200',
        # The default is half of the memory that a node has here.
        'log.cleaner.dedupe.buffer.size': '4194304',
    }
)


class Ports(NamedTuple):
    """Where a node listens: for clients, and for the other controllers."""

    clients: int
    controller: int


class LocalCluster:
    """Several Kafka nodes, each of them broker and controller, each a process of its own.

    A node is named by its number, from 0; its `node.id` is the same. All end with this process,
    however that ends. `stop` or `kill` followed by `start` is a restart of one node with the same
    data and ports.

    Args:
        nodes: How many; of three, one may be away.
        host: The address where they listen: that of a `hosts.Host` if they are started there.
        properties: Properties of every node, over those in `CLUSTER`.
        jvm_flags: Flags of Java, behind the usual ones.
    """

    def __init__(
        self,
        nodes: int = 3,
        host: str = HOST,
        properties: Mapping[str, str] = MappingProxyType({}),
        jvm_flags: Sequence[str] = (),
    ) -> None:
        self._count = nodes
        self._host = host
        self._properties = properties
        self._jvm_flags = (*JVM_FLAGS, *jvm_flags)
        self._directory: Path | None = None
        self._ports: list[Ports] = []
        self._nodes: list[KafkaNode] = []
        self._cluster_id = ''

    @property
    def bootstrap_servers(self) -> str:
        """Where clients find the nodes; the same through all restarts."""
        assert self._ports, 'the cluster has not been started'
        return ','.join(f'{self._host}:{ports.clients}' for ports in self._ports)

    @property
    def directory(self) -> Path:
        """Where the nodes keep data, configuration and log, in a directory each."""
        assert self._directory is not None, 'the cluster has not been started'
        return self._directory

    @property
    def running(self) -> list[int]:
        """The nodes whose processes live."""
        return [number for number, node in enumerate(self._nodes) if node.is_running]

    def log_file(self, node: int) -> Path:
        """A node's log, through all restarts."""
        return self._nodes[node].log_file

    def pid(self, node: int) -> int:
        """A node's process, for tests that pause it."""
        return self._nodes[node].pid

    def __enter__(self) -> Self:
        """Start all nodes and wait until they answer as one cluster.

        Raises:
            ConfigError: Java or Maven is missing.
            TransportError: They did not within two minutes; a log, which then stays, says why.
        """
        try:
            for _ in range(START_ATTEMPTS - 1):
                with suppress(PortLostError):
                    self._start_all()
                    return self
                self._remove()
            self._start_all()
        except TransportError:
            raise  # it names a log, which must stay
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # With the data goes the reason for an end in order, which takes ten times as long.
        for node in self._nodes:
            node.kill()
        if kind is None or not issubclass(kind, TransportError):
            self._remove()  # else it names a log, which must stay

    def start(self, node: int) -> None:
        """Start one node again and wait until the cluster counts it among its own.

        It may still lag behind in the partitions that it holds: `wait_until_in_sync`.

        Raises:
            TransportError: It did not come within two minutes; its log says why.
        """
        self._launch(node)
        others = [self._nodes[number] for number in self.running if number != node]
        nodes = [self._nodes[node], *others]
        wait_for_brokers(nodes, self.bootstrap_servers, self._cluster_id, {node})

    def stop(self, node: int) -> None:
        """Stop one node in order (SIGTERM): it hands over first what it leads."""
        self._nodes[node].stop()

    def kill(self, node: int) -> None:
        """End one node at once (SIGKILL), as a crash does."""
        self._nodes[node].kill()

    def create_topic(
        self,
        topic: str,
        partitions: int = 1,
        replication: int | None = None,
        config: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Create a topic and wait until all its replicas are there.

        Args:
            topic: Its name.
            partitions: How many.
            replication: On how many nodes each is kept; None is on all.
            config: Of the topic, over `min.insync.replicas: 2`.

        Raises:
            KafkaException: The cluster refuses it.
            TransportError: The replicas did not come within two minutes.
        """
        new = NewTopic(
            topic,
            num_partitions=partitions,
            replication_factor=replication or self._count,
            config={'min.insync.replicas': str(self._in_sync), **config},
        )
        admin = AdminClient({'bootstrap.servers': self.bootstrap_servers})
        admin.create_topics([new])[topic].result(REQUEST_S)
        for partition in range(partitions):
            self.wait_until_in_sync(topic, partition)

    def leader(self, topic: str, partition: int = 0) -> int:
        """The node that leads a partition; waits until one that runs does.

        Raises:
            TransportError: None did within two minutes.
        """
        asking = Asking(self.bootstrap_servers)
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            found = _partition(asking, topic, partition)
            if found is not None and found.leader in self.running:
                return found.leader
            time.sleep(PAUSE_S)
        raise TransportError(f'{topic}[{partition}] has no leader for {START_S:.0f} s')

    def wait_until_in_sync(self, topic: str, partition: int = 0) -> None:
        """Wait until every node that holds a partition holds all of it.

        Raises:
            TransportError: It took longer than two minutes.
        """
        asking = Asking(self.bootstrap_servers)
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            found = _partition(asking, topic, partition)
            if found is not None and set(found.isrs) == set(found.replicas):
                return
            time.sleep(PAUSE_S)
        raise TransportError(f'{topic}[{partition}] is not in sync after {START_S:.0f} s')

    @property
    def _in_sync(self) -> int:
        return min(2, self._count)

    def _start_all(self) -> None:
        install_kafka()
        self._directory = Path(tempfile.mkdtemp(prefix='local-cluster-'))
        self._cluster_id = new_id()
        self._ports = [
            Ports(free_port(self._host), free_port(self._host)) for _ in range(self._count)
        ]
        self._nodes = [
            KafkaNode(self._directory / f'node-{number}', self._jvm_flags)
            for number in range(self._count)
        ]
        numbers = range(self._count)
        try:
            with ThreadPoolExecutor(self._count) as threads:
                list(threads.map(self._launch, numbers))
            wait_for_brokers(self._nodes, self.bootstrap_servers, self._cluster_id, set(numbers))
        except BaseException:
            for node in self._nodes:
                node.kill()
            raise

    def _launch(self, node: int) -> None:
        self._nodes[node].start(self._properties_of(node), self._cluster_id)

    def _properties_of(self, node: int) -> dict[str, str]:
        here = self._ports[node]
        voters = [f'{n}@{self._host}:{ports.controller}' for n, ports in enumerate(self._ports)]
        return {
            **CLUSTER,
            **replication(self._count, self._in_sync),
            **self._properties,
            'node.id': str(node),
            'listeners': (
                f'PLAINTEXT://{self._host}:{here.clients},'
                f'CONTROLLER://{self._host}:{here.controller}'
            ),
            'controller.quorum.voters': ','.join(voters),
        }

    def _remove(self) -> None:
        if self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)
            self._directory = None


def _partition(asking: Asking, topic: str, partition: int) -> PartitionMetadata | None:
    found = asking.metadata(topic)
    return None if found is None else found.topics[topic].partitions.get(partition)
