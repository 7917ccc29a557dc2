"""A real Apache Kafka on this machine: one KRaft node, up in about two seconds.

`LocalKafka` is for tests. `python -m ros2_kafka_bridge.testing.local_kafka` is for trying things
out: it runs one in the foreground. Both need Java 17 or newer and, the first time, Maven.
"""

import argparse
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Final, NoReturn, Self, TextIO

from ros2_kafka_bridge.errors import BridgeError, ConfigError, TransportError
from ros2_kafka_bridge.testing.kafka_jars import ARCHIVE, fetch_jars, find_jars
from ros2_kafka_bridge.testing.kafka_node import (
    HOST,
    PROPERTIES,
    KafkaNode,
    PortLostError,
    free_port,
    is_free,
    replication,
    wait_for_brokers,
)

__all__ = ['HOST', 'QUICK_RETURN', 'LocalKafka', 'free_port', 'install_kafka']

NODE_ID: Final = 1
START_ATTEMPTS: Final = 5

ONE_NODE: Final[Mapping[str, str]] = MappingProxyType(
    {
        **PROPERTIES,
        **replication(1, 1),
        'node.id': str(NODE_ID),
        # It outlives a machine that stands still for seconds, and tells less often that it lives,
        # which alone took 4 % of a core.
        'broker.heartbeat.interval.ms': '2000',
        'broker.session.timeout.ms': '10000',
        'metadata.max.idle.interval.ms': '5000',
    }
)

QUICK_RETURN: Final[Mapping[str, str]] = MappingProxyType(
    {'broker.heartbeat.interval.ms': '200', 'broker.session.timeout.ms': '1500'}
)
"""Properties of a node that is killed and started again, and is to be back in 2 s.

The controller waits for the end of the session before it lets it in. On a machine that stands
still for as long, the node fences itself.
"""


class LocalKafka:
    """One Kafka node that is broker and controller, on 127.0.0.1 where nothing else is said.

    The node is a process of its own; it ends with this one, however that ends. `stop` or `kill`
    followed by `start` is a restart with the same data, directory and port; after a `kill` that
    takes 11 s, or 2 s with the properties `QUICK_RETURN`. Any number of nodes can run at once.

    Args:
        directory: Keeps data, configuration and log; None makes one that ends with the `with`.
        port: Where clients connect; 0 chooses a free one.
        properties: Properties of the broker, over its own. `listeners` adds to the
            node's own two, for example `SSL://127.0.0.1:29093` (see `free_port`).
        jvm_flags: Flags of Java, behind its own.
        host: The address where it listens: one of the network that it is started in.
    """

    def __init__(
        self,
        directory: Path | None = None,
        port: int = 0,
        properties: Mapping[str, str] = MappingProxyType({}),
        jvm_flags: Sequence[str] = (),
        host: str = HOST,
    ) -> None:
        self._host = host
        self._is_temporary = directory is None
        self._directory = None if directory is None else directory.absolute()
        self._port = port
        self._controller_port = 0
        self._properties = properties
        self._jvm_flags = jvm_flags
        self._started: KafkaNode | None = None

    @property
    def port(self) -> int:
        """Where clients connect; the same through all restarts."""
        assert self._port, 'the node has not been started'
        return self._port

    @property
    def bootstrap_servers(self) -> str:
        """Where clients find the node; the same through all restarts."""
        return f'{self._host}:{self.port}'

    @property
    def directory(self) -> Path:
        """Where the node keeps data, configuration and log."""
        assert self._directory is not None, 'the node has not been started'
        return self._directory

    @property
    def log_file(self) -> Path:
        """The node's log, through all restarts."""
        return self._node.log_file

    @property
    def pid(self) -> int:
        """The node's process, for tests that pause it."""
        return self._node.pid

    @property
    def is_running(self) -> bool:
        """Whether the node's process lives."""
        return self._started is not None and self._started.is_running

    def __enter__(self) -> Self:
        try:
            self.start()
        except TransportError:
            raise  # it names the log, which must stay
        except BaseException:
            self._remove_temporary()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.stop()
        finally:
            self._remove_temporary()

    def start(self) -> None:
        """Start the node and wait until it answers.

        Raises:
            ConfigError: Java or Maven is missing, or the port is taken.
            TransportError: The node ended or did not answer within two minutes; the log says why.
        """
        assert not self.is_running, 'the node runs already'
        wanted = self._port, self._controller_port
        for _ in range(START_ATTEMPTS - 1):
            self._choose_ports(*wanted)
            with suppress(PortLostError):
                self._start_once()
                return
        self._choose_ports(*wanted)
        self._start_once()

    def stop(self) -> None:
        """Stop the node in order (SIGTERM); one that takes longer than 15 s is killed."""
        if self._started is not None:
            self._started.stop()

    def kill(self) -> None:
        """End the node at once (SIGKILL), as a crash does."""
        if self._started is not None:
            self._started.kill()

    def wait(self) -> NoReturn:
        """Wait until the node ends by itself.

        Raises:
            TransportError: It did; the log says why.
        """
        self._node.wait()
        raise TransportError(self._node.failure('Kafka ended'))

    @property
    def _node(self) -> KafkaNode:
        assert self._started is not None, 'the node has not been started'
        return self._started

    def _remove_temporary(self) -> None:
        if self._is_temporary and self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)
            self._directory = None
            self._started = None

    def _choose_ports(self, port: int, controller_port: int) -> None:
        if port and not is_free(port, self._host):
            cure = 'stop what listens there, or choose another port'
            raise ConfigError([f'port {port} of {self._host} is in use: {cure}'])
        self._port = port or free_port(self._host)
        self._controller_port = controller_port or free_port(self._host)

    def _start_once(self) -> None:
        install_kafka()
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='local-kafka-'))
        self._started = node = self._started or KafkaNode(self._directory, self._jvm_flags)
        try:
            cluster_id = node.start(self._all_properties())
            wait_for_brokers([node], self.bootstrap_servers, cluster_id, {NODE_ID})
        except BaseException:
            node.kill()
            raise

    def _all_properties(self) -> dict[str, str]:
        clients = f'PLAINTEXT://{self._host}:{self._port}'
        controller = f'{self._host}:{self._controller_port}'
        own = f'{clients},CONTROLLER://{controller}'
        more = self._properties.get('listeners')
        return {
            **ONE_NODE,
            **self._properties,
            'listeners': f'{own},{more}' if more else own,
            'controller.quorum.voters': f'{NODE_ID}@{controller}',
        }


def install_kafka(directory: Path | None = None) -> Path:
    """Let Maven fetch Kafka's jars, if they are not there yet, and map its classes then.

    Args:
        directory: Where they are put. The default is what the environment variable
            ROS2_KAFKA_BRIDGE_KAFKA_JARS names, else `.kafka/jars` if there is one here, else a
            directory in the user's cache. `LocalKafka` looks at the default only.

    Returns:
        The directory that holds the jars.

    Raises:
        ConfigError: Java or Maven is missing, or Maven cannot fetch the jars.
    """
    fetched = fetch_jars(directory)
    if fetched.is_new:
        make_archive(fetched.directory)
    return fetched.directory


def make_archive(jars: Path) -> None:
    """Run a node once, and keep the classes that it has loaded; without them it is only slower."""
    with tempfile.TemporaryDirectory(dir=jars.parent) as scratch:
        made = Path(scratch) / ARCHIVE
        # What goes wrong is said by whoever needs a node.
        with suppress(BridgeError), LocalKafka(jvm_flags=(f'-XX:ArchiveClassesAtExit={made}',)):
            pass
        if made.is_file():
            made.rename(jars / ARCHIVE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a node in the foreground until SIGINT or SIGTERM.

    Returns:
        The exit status: 0 stopped, 1 the node failed, 2 it could not be started.
    """
    options = _parse(arguments)
    # Both, because a shell starts its background jobs with SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if find_jars() is None:
            _say('Maven fetches Kafka, this once ...')
        with LocalKafka(options.directory, options.port) as kafka:
            _say(f'Kafka answers at {kafka.bootstrap_servers}, its log is {kafka.log_file}')
            if options.topics:
                _create_topics(kafka.bootstrap_servers, options.topics)
                _say(f'It has the topics {", ".join(options.topics)}.')
            _say(
                'Ctrl-C stops it.' if options.directory else 'Ctrl-C stops it and drops its data.'
            )
            kafka.wait()
    except KeyboardInterrupt:
        return 0
    except ConfigError as error:
        _say(str(error), sys.stderr)
        return 2
    except TransportError as error:
        _say(str(error), sys.stderr)
        return 1


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m ros2_kafka_bridge.testing.local_kafka',
        description='Runs a real one-node Kafka in the foreground, until Ctrl-C.',
    )
    parser.add_argument(
        '--port', type=int, default=9092, help='where clients connect (default: %(default)s)'
    )
    parser.add_argument(
        '--directory',
        type=Path,
        help='keeps data and log (default: a temporary directory); after a SIGKILL the next node '
        'that is started with them answers 10 s later than otherwise',
    )
    parser.add_argument(
        '--topics', nargs='*', default=[], metavar='TOPIC', help='topics to create'
    )
    return parser.parse_args(arguments)


def _create_topics(bootstrap_servers: str, topics: Sequence[str]) -> None:
    from ros2_kafka_bridge.kafka.topics import ensure_topic  # noqa: PLC0415 (heavy)

    for topic in topics:
        ensure_topic({'bootstrap.servers': bootstrap_servers}, topic)


def _say(sentence: str, stream: TextIO | None = None) -> None:
    print(sentence, file=stream or sys.stdout, flush=True)


if __name__ == '__main__':
    sys.exit(main())
