"""A real Apache Kafka on this machine: one KRaft node, up in about three seconds.

`LocalKafka` is for tests. `python -m ros2_kafka_bridge.testing.local_kafka` is for trying things
out: it runs one in the foreground. Both need Java 17 or newer and, the first time, Maven.
"""

import argparse
import base64
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Thread
from types import MappingProxyType, TracebackType
from typing import Final, NoReturn, Self, TextIO

from confluent_kafka import KafkaException
from confluent_kafka.admin import AdminClient

from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.kafka_jars import find_jars, install_jars, java

HOST: Final = '127.0.0.1'
START_S: Final = 60.0
STOP_S: Final = 15.0

# Below the ports that systems hand out to clients: a client that tries again and again to reach
# a node that is down could otherwise take the node's own port.
PORTS: Final = range(20_000, 32_000)
START_ATTEMPTS: Final = 5

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
        'node.id': '1',
        'controller.listener.names': 'CONTROLLER',
        'listener.security.protocol.map': (
            'CONTROLLER:PLAINTEXT,PLAINTEXT:PLAINTEXT,SSL:SSL,'
            'SASL_PLAINTEXT:SASL_PLAINTEXT,SASL_SSL:SASL_SSL'
        ),
        'auto.create.topics.enable': 'true',
        'num.partitions': '1',
        'default.replication.factor': '1',
        'offsets.topic.num.partitions': '1',
        'offsets.topic.replication.factor': '1',
        'transaction.state.log.num.partitions': '1',
        'transaction.state.log.replication.factor': '1',
        'transaction.state.log.min.isr': '1',
        'share.coordinator.state.topic.num.partitions': '1',
        'share.coordinator.state.topic.replication.factor': '1',
        'share.coordinator.state.topic.min.isr': '1',
        'group.initial.rebalance.delay.ms': '0',
        'group.min.session.timeout.ms': '1000',
        # After a kill, the controller waits this long before it lets the same node in again.
        'broker.session.timeout.ms': '1500',
        'broker.heartbeat.interval.ms': '200',
    }
)

# A node must not outlive its owner, even one that was killed. The kernel sends this signal when
# the *thread* that started the process ends, hence `_own`. Set in the child by a program of its
# own: code between fork and exec is not safe in a process with threads.
_DIE_WITH_OWNER: Final = (
    'import ctypes, os, sys\n'
    'ctypes.CDLL(None).prctl(1, 9)\n'  # PR_SET_PDEATHSIG, SIGKILL
    'if os.getppid() == int(sys.argv[1]): os.execvp(sys.argv[2], sys.argv[2:])\n'
)


class _PortLostError(TransportError):
    """Between the choice of a port and its use, somebody else has taken it."""


class LocalKafka:
    """One Kafka node that is broker and controller, on 127.0.0.1.

    The node is a process of its own; it ends with this one, however that ends. `stop` or `kill`
    followed by `start` is a restart with the same data, directory and port. Any number of nodes
    can run at once.

    Args:
        directory: Keeps data, configuration and log; None makes one that ends with the `with`.
        port: Where clients connect; 0 chooses a free one.
        properties: Properties of the broker, over those in `PROPERTIES`. `listeners` adds to the
            node's own two, for example `SSL://127.0.0.1:29093` (see `free_port`).
        jvm_flags: Flags of Java, behind those in `JVM_FLAGS`.
    """

    def __init__(
        self,
        directory: Path | None = None,
        port: int = 0,
        properties: Mapping[str, str] = MappingProxyType({}),
        jvm_flags: Sequence[str] = (),
    ) -> None:
        self._is_temporary = directory is None
        self._directory = None if directory is None else directory.absolute()
        self._port = port
        self._controller_port = 0
        self._properties = properties
        self._jvm_flags = jvm_flags
        self._process: subprocess.Popen[bytes] | None = None
        self._log_offset = 0

    @property
    def port(self) -> int:
        """Where clients connect; the same through all restarts."""
        assert self._port, 'the node has not been started'
        return self._port

    @property
    def bootstrap_servers(self) -> str:
        """Where clients find the node; the same through all restarts."""
        return f'{HOST}:{self.port}'

    @property
    def directory(self) -> Path:
        """Where the node keeps data, configuration and log."""
        assert self._directory is not None, 'the node has not been started'
        return self._directory

    @property
    def log_file(self) -> Path:
        """The node's log, through all restarts."""
        return self.directory / 'kafka.log'

    @property
    def pid(self) -> int:
        """The node's process, for tests that pause it."""
        assert self._process is not None, 'the node does not run'
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether the node's process lives."""
        return self._process is not None and self._process.poll() is None

    def __enter__(self) -> Self:
        try:
            self.start()
        except TransportError:
            raise  # it names the log, which must stay
        except BaseException:
            self._remove_temporary()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.stop()
        finally:
            self._remove_temporary()

    def start(self) -> None:
        """Start the node and wait until it answers.

        Raises:
            ConfigError: Java or Maven is missing, or the port is taken.
            TransportError: The node ended or did not answer within a minute; the log says why.
        """
        assert not self.is_running, 'the node runs already'
        jars = install_jars()
        command = [java(), *JVM_FLAGS, *LOG_FLAGS, *self._jvm_flags, '-cp', f'{jars}/*']
        wanted = self._port, self._controller_port
        for _ in range(START_ATTEMPTS - 1):
            self._choose_ports(*wanted)
            with suppress(_PortLostError):
                self._start_once(command)
                return
        self._choose_ports(*wanted)
        self._start_once(command)

    def stop(self) -> None:
        """Stop the node in order (SIGTERM); one that takes longer than 15 s is killed."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
        self._process = None

    def kill(self) -> None:
        """End the node at once (SIGKILL), as a crash does."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        self._process = None

    def wait(self) -> NoReturn:
        """Wait until the node ends by itself.

        Raises:
            TransportError: It did; the log says why.
        """
        assert self._process is not None, 'the node does not run'
        self._process.wait()
        raise TransportError(self._failure('Kafka ended'))

    def _make_directory(self) -> None:
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='local-kafka-'))
        self._directory.mkdir(parents=True, exist_ok=True)

    def _remove_temporary(self) -> None:
        if self._is_temporary and self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)
            self._directory = None

    def _choose_ports(self, port: int, controller_port: int) -> None:
        if port and not _is_free(port):
            cure = 'stop what listens there, or choose another port'
            raise ConfigError([f'port {port} of {HOST} is in use: {cure}'])
        self._port = port or free_port()
        self._controller_port = controller_port or free_port()

    def _start_once(self, java: Sequence[str]) -> None:
        self._make_directory()
        config = self._write_config()
        self._log_offset = self.log_file.stat().st_size if self.log_file.exists() else 0
        cluster_id = self._format(java, config)
        self._process = _start_process([*java, 'kafka.Kafka', str(config)], self.log_file)
        try:
            self._wait_for_answer(cluster_id)
        except BaseException:
            self.kill()
            raise

    def _write_config(self) -> Path:
        own = f'PLAINTEXT://{HOST}:{self._port},CONTROLLER://{HOST}:{self._controller_port}'
        more = self._properties.get('listeners')
        properties = {
            **PROPERTIES,
            **self._properties,
            'listeners': f'{own},{more}' if more else own,
            'controller.quorum.voters': f'1@{HOST}:{self._controller_port}',
            'log.dirs': str(self.directory / 'data'),
        }
        config = self.directory / 'server.properties'
        lines = [f'{name}={value}\n' for name, value in properties.items()]
        config.write_text(''.join(lines), encoding='utf-8')
        return config

    def _format(self, java: Sequence[str], config: Path) -> str:
        """Give the data directory its cluster id, if it has none yet."""
        meta = self.directory / 'data' / 'meta.properties'
        if not meta.exists():
            tool = ['kafka.tools.StorageTool', 'format', '--config', str(config)]
            process = _start_process([*java, *tool, '--cluster-id', _new_id()], self.log_file)
            if process.wait():
                raise TransportError(self._failure('Kafka could not format its data directory'))
        found = re.search(r'^cluster\.id=(.+)$', meta.read_text(encoding='utf-8'), re.MULTILINE)
        assert found is not None, f'{meta} names no cluster'
        return found[1]

    def _wait_for_answer(self, cluster_id: str) -> None:
        assert self._process is not None
        admin = AdminClient(
            {
                'bootstrap.servers': self.bootstrap_servers,
                'reconnect.backoff.ms': 20,
                'reconnect.backoff.max.ms': 50,
                'log_level': 0,  # that nobody answers yet is no news
            }
        )
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            if self._process.poll() is not None:
                raise self._start_failure()
            with suppress(KafkaException):
                cluster = admin.list_topics(timeout=0.2)
                if cluster.brokers and cluster.cluster_id == cluster_id:
                    return
        raise TransportError(self._failure(f'Kafka did not answer within {START_S:.0f} s'))

    def _log_since_start(self) -> str:
        with self.log_file.open('rb') as log:
            log.seek(self._log_offset)
            return log.read().decode(errors='replace')

    def _start_failure(self) -> TransportError:
        is_port_lost = 'Address already in use' in self._log_since_start()
        kind = _PortLostError if is_port_lost else TransportError
        return kind(self._failure('Kafka ended while it started'))

    def _failure(self, what: str) -> str:
        signs = ('ERROR', 'Exception', 'error:')
        lines = self._log_since_start().splitlines()
        reason = next((line.strip() for line in lines if any(sign in line for sign in signs)), '')
        return f'{what}, see {self.log_file}' + (f': {reason}' if reason else '')


def free_port() -> int:
    """A port of 127.0.0.1 that nobody listens on, and that no client's end can take."""
    return next(port for port in random.SystemRandom().sample(PORTS, len(PORTS)) if _is_free(port))


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
        '--directory', type=Path, help='keeps data and log (default: a temporary directory)'
    )
    parser.add_argument(
        '--topics', nargs='*', default=[], metavar='TOPIC', help='topics to create'
    )
    return parser.parse_args(arguments)


def _create_topics(bootstrap_servers: str, topics: Sequence[str]) -> None:
    from ros2_kafka_bridge.kafka.admin import ensure_topic  # noqa: PLC0415 (heavy)

    for topic in topics:
        ensure_topic({'bootstrap.servers': bootstrap_servers}, topic)


def _say(sentence: str, stream: TextIO | None = None) -> None:
    print(sentence, file=stream or sys.stdout, flush=True)


def _start_process(command: Sequence[str], log_file: Path) -> subprocess.Popen[bytes]:
    started: Future[subprocess.Popen[bytes]] = Future()
    Thread(target=_own, args=(command, log_file, started), name='local-kafka', daemon=True).start()
    return started.result()


def _own(command: Sequence[str], log_file: Path, started: Future[subprocess.Popen[bytes]]) -> None:
    """Start a process and live as long as it does, because it does not live longer."""
    starter = [sys.executable, '-I', '-S', '-c', _DIE_WITH_OWNER, str(os.getpid())]
    try:
        with log_file.open('ab') as log:
            process = subprocess.Popen(  # noqa: S603 - a command of this file
                [*starter, *command],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,  # Ctrl-C is for the owner, who stops the node in order
            )
    except OSError as error:
        started.set_exception(error)
        return
    started.set_result(process)
    process.wait()


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
        return True


def _new_id() -> str:
    # 16 bytes; the first keeps the text from starting with a dash, as options do.
    return base64.urlsafe_b64encode(b'\0' + os.urandom(15)).decode().rstrip('=')


if __name__ == '__main__':
    sys.exit(main())
