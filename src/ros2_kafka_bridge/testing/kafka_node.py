"""One Kafka process: its properties, its directory, its life. `LocalKafka` is made of one."""

import base64
import errno
import os
import random
import re
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Final

from confluent_kafka import KafkaException
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AdminClient,
    ClusterMetadata,
)

from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.kafka_jars import archive_flags, install_jars, java
from ros2_kafka_bridge.testing.owned import start_owned

HOST: Final = '127.0.0.1'
"""Where a node listens if nothing else is said: nobody beyond this machine reaches it."""

START_S: Final = 120.0
STOP_S: Final = 15.0
FORMAT_S: Final = 120.0

# Below the ports that systems hand out to clients: a client that tries again and again to reach
# a node that is down could otherwise take the node's own port.
PORTS: Final = range(20_000, 32_000)

# The quick compiler alone starts a node in 1.8 s instead of 2.5 s; on few cores, which the node
# shares with its clients, it also carries more records per second, as does the serial collector.
JVM_FLAGS: Final = ('-Xms128m', '-Xmx512m', '-XX:TieredStopAtLevel=1', '-XX:+UseSerialGC')
LOG_FLAGS: Final = (
    '-Dorg.slf4j.simpleLogger.showDateTime=true',
    '-Dorg.slf4j.simpleLogger.dateTimeFormat=yyyy-MM-dd HH:mm:ss.SSS',
)

PROPERTIES: Final[Mapping[str, str]] = MappingProxyType(
    {
        'process.roles': 'broker,controller',
        'controller.listener.names': 'CONTROLLER',
        'listener.security.protocol.map': (
            'CONTROLLER:PLAINTEXT,PLAINTEXT:PLAINTEXT,SSL:SSL,'
            'SASL_PLAINTEXT:SASL_PLAINTEXT,SASL_SSL:SASL_SSL'
        ),
        'auto.create.topics.enable': 'true',
        'num.partitions': '1',
        'offsets.topic.num.partitions': '1',
        'transaction.state.log.num.partitions': '1',
        'share.coordinator.state.topic.num.partitions': '1',
        'group.initial.rebalance.delay.ms': '0',
        'group.min.session.timeout.ms': '1000',
    }
)

# The exception itself says more than the line before it, that there is one.
_REASONS: Final = (
    re.compile(r'^[\w.$]+(Exception|Error): '),
    re.compile(r'ERROR|Exception|error:'),
)


def replication(copies: int, in_sync: int) -> dict[str, str]:
    """The properties that say how often a node's topics, and Kafka's own, are kept.

    Args:
        copies: Of each partition.
        in_sync: How many of them must have a record before it is acknowledged.
    """
    return {
        'default.replication.factor': str(copies),
        'min.insync.replicas': str(in_sync),
        'offsets.topic.replication.factor': str(copies),
        'transaction.state.log.replication.factor': str(copies),
        'transaction.state.log.min.isr': str(in_sync),
        'share.coordinator.state.topic.replication.factor': str(copies),
        'share.coordinator.state.topic.min.isr': str(in_sync),
    }


class PortLostError(TransportError):
    """Between the choice of a port and its use, somebody else has taken it."""


class KafkaNode:
    """One process; it ends with this one, however that ends.

    Args:
        directory: Keeps data, configuration and log; it is made if need be.
        jvm_flags: Flags of Java, behind those in `JVM_FLAGS`.
    """

    def __init__(self, directory: Path, jvm_flags: Sequence[str] = ()) -> None:
        self.directory = directory
        self._jvm_flags = jvm_flags
        self._process: subprocess.Popen[bytes] | None = None
        self._log_offset = 0

    @property
    def log_file(self) -> Path:
        """The log, through all restarts."""
        return self.directory / 'kafka.log'

    @property
    def pid(self) -> int:
        """The process."""
        assert self._process is not None, 'the node does not run'
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._process is not None and self._process.poll() is None

    def start(self, properties: Mapping[str, str], cluster_id: str | None = None) -> str:
        """Start the process; whether it answers is seen by its clients.

        Args:
            properties: All of the node's, but for its directory.
            cluster_id: For a directory that is in no cluster yet; None makes one.

        Returns:
            The id of its cluster.

        Raises:
            ConfigError: Java or Maven is missing.
            TransportError: The directory could not be made ready; the log says why.
        """
        assert not self.is_running, 'the node runs already'
        self.directory.mkdir(parents=True, exist_ok=True)
        self._log_offset = self.log_file.stat().st_size if self.log_file.exists() else 0
        jars = install_jars()
        flags = [*JVM_FLAGS, *LOG_FLAGS, *archive_flags(jars), *self._jvm_flags]
        program = [java(), *flags, '-cp', f'{jars}/*']
        config = self._write_config(properties)
        found = self._format(program, config, cluster_id)
        self._process = start_owned([*program, 'kafka.Kafka', str(config)], self.log_file)
        return found

    def check(self) -> None:
        """Find out whether a node that was started still runs.

        Raises:
            PortLostError: It does not, because one of its ports is taken.
            TransportError: It does not; the log says why.
        """
        if self.is_running:
            return
        is_port_lost = 'Address already in use' in self._log_since_start()
        kind = PortLostError if is_port_lost else TransportError
        raise kind(self.failure('Kafka ended while it started'))

    def stop(self) -> None:
        """Stop the process in order (SIGTERM); one that takes longer than 15 s is killed."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
        self._process = None

    def kill(self) -> None:
        """End the process at once (SIGKILL), as a crash does."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        self._process = None

    def wait(self) -> None:
        """Wait until the process ends by itself."""
        assert self._process is not None, 'the node does not run'
        self._process.wait()

    def failure(self, what: str) -> str:
        """A sentence of what happened, where the log is, and its first complaint."""
        lines = self._log_since_start().splitlines()
        found = filter(None, (next(filter(sign.search, lines), '') for sign in _REASONS))
        reason = next(found, '').strip()
        return f'{what}, see {self.log_file}' + (f': {reason}' if reason else '')

    def _write_config(self, properties: Mapping[str, str]) -> Path:
        config = self.directory / 'server.properties'
        all_of_them = {**properties, 'log.dirs': str(self.directory / 'data')}
        lines = [f'{name}={value}\n' for name, value in all_of_them.items()]
        config.write_text(''.join(lines), encoding='utf-8')
        return config

    def _format(self, program: Sequence[str], config: Path, cluster_id: str | None) -> str:
        """Give the data directory its cluster's id, if it has none yet."""
        meta = self.directory / 'data' / 'meta.properties'
        if not meta.exists():
            tool = ['kafka.tools.StorageTool', 'format', '--config', str(config)]
            options = ['--cluster-id', cluster_id or new_id()]
            process = start_owned([*program, *tool, *options], self.log_file)
            try:
                status = process.wait(FORMAT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                raise TransportError(self.failure('Kafka does not format its directory')) from None
            if status:
                raise TransportError(self.failure('Kafka could not format its data directory'))
        found = re.search(r'^cluster\.id=(.+)$', meta.read_text(encoding='utf-8'), re.MULTILINE)
        assert found is not None, f'{meta} names no cluster'
        return found[1]

    def _log_since_start(self) -> str:
        with self.log_file.open('rb') as log:
            log.seek(self._log_offset)
            return log.read().decode(errors='replace')


class Asking:
    """A client that asks a cluster again and again, also while nobody answers yet."""

    def __init__(self, bootstrap_servers: str) -> None:
        self._admin = AdminClient(
            {
                'bootstrap.servers': bootstrap_servers,
                'reconnect.backoff.ms': 20,
                'reconnect.backoff.max.ms': 50,
                'log_level': 0,  # that nobody answers yet is no news
            }
        )

    def metadata(self, topic: str | None = None) -> ClusterMetadata | None:
        """What the cluster says of itself, None where nobody answers within 0.2 s."""
        with suppress(KafkaException):
            return self._admin.list_topics(topic, timeout=0.2)
        return None


def wait_for_brokers(
    nodes: Sequence[KafkaNode], bootstrap_servers: str, cluster_id: str, brokers: set[int]
) -> None:
    """Wait until a cluster answers and counts these brokers among its own.

    Args:
        nodes: That must keep running meanwhile; the error names the log of the first.
        bootstrap_servers: Where to ask.
        cluster_id: What must answer there.
        brokers: Their ids.

    Raises:
        TransportError: A node ended, or it took longer than two minutes.
    """
    asking = Asking(bootstrap_servers)
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        for node in nodes:
            node.check()
        found = asking.metadata()
        if found is not None and found.cluster_id == cluster_id and brokers <= set(found.brokers):
            return
    raise TransportError(nodes[0].failure(f'Kafka did not answer within {START_S:.0f} s'))


def free_port(host: str = HOST) -> int:
    """A port of this machine that nobody listens on, and that no client's end can take.

    Raises:
        ConfigError: The address is not one of this machine.
    """
    ports = random.SystemRandom().sample(PORTS, len(PORTS))
    return next(port for port in ports if is_free(port, host))


def is_free(port: int, host: str = HOST) -> bool:
    """Whether nobody listens on a port.

    Raises:
        ConfigError: The address is not one of this machine.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise ConfigError([f'{host} is no address of this machine']) from error
            return False
        return True


def new_id() -> str:
    """An id for a cluster."""
    # 16 bytes; the first keeps the text from starting with a dash, as options do.
    return base64.urlsafe_b64encode(b'\0' + os.urandom(15)).decode().rstrip('=')
