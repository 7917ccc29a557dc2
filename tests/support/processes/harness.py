"""Processes and Kafka clients that the integration tests and fault tests work with."""

import contextlib
import os
import re
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from confluent_kafka import Consumer, KafkaError, KafkaException, Message, Producer, TopicPartition
from confluent_kafka.admin import AdminClient
from confluent_kafka.cimpl import NewTopic  # which `admin` does not name in its __all__
from ruamel.yaml import YAML
from support.bridges.routes import gaps
from support.patience import eventually, patient
from support.processes.warm import Warm

from rig.hosts import Host
from rig.processes import WAIT_S as PATIENCE_S
from rig.processes import Process, Programs
from rig.topics import headers
from ros2_kafka_bridge.ros.fastdds_profile import FASTDDS_3, Histories, make_profile

__all__ = [
    'PATIENCE_S',
    'PEERS',
    'START',
    'Bench',
    'Process',
    'eventually',
    'headers',
    'wait_until_it_reads',
]

PEERS = Path(__file__).parents[2] / 'peers'
READ_AT_THE_START = {'PYTHONPATH', 'LD_LIBRARY_PATH', 'LD_PRELOAD'}  # by Python and the linker
START = ('-P', '-m', 'ros2_kafka_bridge.process.start', '--log-format=text', '--routes=')


def _started(process: Process) -> Process:
    process.start()
    return process


def wait_until_it_reads(bridge: Process, topic: str) -> None:
    """Wait until a bridge has got a partition: a group begins with giving it none."""
    reads = re.compile(rf'reads {re.escape(topic)}\[\d')
    eventually(lambda: bool(reads.search(bridge.output())), PATIENCE_S, bridge.output)


class Bench:
    """What a test works with: a place for files, a broker, a ROS domain, a bridge's name.

    Args:
        place: Where its files go.
        bootstrap_servers: Of the broker.
        domain: The ROS domain.
        host: Where its processes run, on this machine if None.
        name: Of the bridge, and so of its groups and clients; one that nobody else has if None.
    """

    def __init__(
        self,
        place: Path,
        bootstrap_servers: str,
        domain: int,
        *,
        host: Host | None = None,
        name: str | None = None,
    ) -> None:
        self.place = place
        self.bootstrap_servers = bootstrap_servers
        self.domain = domain
        self.name = name or f'test-{uuid.uuid4().hex[:8]}'
        self._programs = Programs(place, {'ROS_DOMAIN_ID': str(domain)}, host)
        self._count = 0
        self._clients: dict[str, Consumer] = {}
        self._producers: list[Producer] = []

    def on(self, host: Host) -> 'Bench':
        """The same, but what it starts runs on that host."""
        place = self.place / host.name
        place.mkdir(exist_ok=True)
        return Bench(place, self.bootstrap_servers, self.domain, host=host, name=self.name)

    @property
    def patient_kafka(self) -> dict[str, Any]:
        """`kafka` of a bridge that stays in its groups while a busy machine stands still.

        What Kafka takes for dead may commit no more: then a stop repeats what was in flight.
        """
        return {'bootstrap.servers': self.bootstrap_servers, 'session.timeout.ms': 60_000}

    @property
    def group(self) -> str:
        """The consumer group of the route `to_ros`."""
        return f'{self.name}.to_ros'

    @property
    def node(self) -> str:
        """The ROS node of a bridge that has one."""
        return '/kafka_bridge_' + self.name.replace('-', '_')

    @property
    def environ(self) -> dict[str, str]:
        """The environment of what the test starts."""
        return {**os.environ, **self._programs.environ}

    def config(self, routes: list[dict[str, Any]], name: str = '', **more: Any) -> Path:
        """Write a configuration file; returns its path."""
        content = {
            'name': name or self.name,
            'kafka': {'bootstrap.servers': self.bootstrap_servers},
            'routes': routes,
            **more,
        }
        path = self._file('yaml')
        with path.open('w') as file:
            YAML(typ='safe').dump(content, file)
        return path

    def bridge(self, config: Path, *, python: Path | None = None, **environ: str) -> Process:
        """Start the bridge, with another Python than that of the tests where one is given.

        It begins as the process that `run` becomes (`test_cli` looks at its words), and warm:
        hundreds of times from nothing would be a third of what all tests take.
        """
        command = (*START, '--', str(config))
        if python is None:
            return self._begin(*command, **environ)
        # The wheels of ROS 2 have set these to their own libraries.
        own = {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '', 'LD_LIBRARY_PATH': ''}
        program = self._programs.command(self._name(), str(python), *command, **own, **environ)
        return _started(program)

    @contextlib.contextmanager
    def drained(
        self, config: Path, *, python: Path | None = None, **environ: str
    ) -> Iterator[Process]:
        """Start the bridge; where the test is through with it, it drains, and ends with 0."""
        with self.bridge(config, python=python, **environ) as bridge:
            yield bridge
            assert bridge.end(60) == 0, bridge.output()

    def run(self, config: Path, *options: str, **environ: str) -> Process:
        """Start the bridge by the command line."""
        return _started(self._programs.bridge(self._name(), config, *options, **environ))

    def command(
        self, *arguments: str, timeout_s: float = 120.0, **environ: str
    ) -> tuple[int, str, str]:
        """Run the command line to its end; returns status, standard output, standard error."""
        done = subprocess.run(
            [sys.executable, '-m', 'ros2_kafka_bridge', *arguments],
            capture_output=True,
            text=True,
            timeout=patient(timeout_s),
            stdin=subprocess.DEVNULL,
            check=False,
            env=self.environ | environ,
        )
        return done.returncode, done.stdout, done.stderr

    def publisher(self, topic: str, *options: str, **environ: str) -> Process:
        """Start a ROS node that publishes (rig/peers/publisher.py)."""
        return self.peer('publisher', topic, *options, **environ)

    def subscriber(
        self,
        topic: str,
        file: Path,
        *options: str,
        samples: int | None = None,
        lease_s: float | None = None,
        **environ: str,
    ) -> Process:
        """Start a ROS node that reads into a file (rig/peers/subscriber.py).

        It takes `samples` into its DDS cache (default 5000), and is given up `lease_s` after it
        was killed (default 20).
        """
        if samples is not None or lease_s is not None:
            readers = {} if samples is None else {topic: samples}
            profile = self._file('xml')
            profile.write_text(make_profile(Histories({}, readers, lease_s)))
            environ[FASTDDS_3.variable] = str(profile)
        return self.peer('subscriber', topic, str(file), *options, **environ)

    def peer(self, name: str, *arguments: str, **environ: str) -> Process:
        """Start an end of rig/peers."""
        return self._begin('-m', f'rig.peers.{name}', *arguments, **environ)

    def script(self, name: str, *arguments: str) -> Process:
        """Start a script of tests/peers."""
        return self._begin(str(PEERS / name), *arguments)

    def _begin(self, *arguments: str, **environ: str) -> Process:
        if self._programs.host is not None or not READ_AT_THE_START.isdisjoint(environ):
            return self._start(*arguments, **environ)
        warm = self._programs._replace(begin=Warm)
        return _started(warm.command(self._name(), *arguments, **environ))

    def _start(self, *arguments: str, **environ: str) -> Process:
        return _started(self._programs.python(self._name(), *arguments, **environ))

    def _file(self, suffix: str) -> Path:
        return self.place / f'{self._name()}.{suffix}'

    def _name(self) -> str:
        self._count += 1
        return str(self._count)

    # Kafka

    def create_topic(self, *topics: str, partitions: int = 1, **config: str) -> None:
        """Create topics; config keys with `_` for `.`."""
        properties = {key.replace('_', '.'): value for key, value in config.items()}
        new = [NewTopic(it, partitions, replication_factor=1, config=properties) for it in topics]
        admin = self.admin()  # kept: its futures fail when it goes
        for topic, done in admin.create_topics(new).items():
            done.result(patient(PATIENCE_S))
            # Until its leader has begun, it may pass over the first record of a test's producer.
            for partition in range(partitions):
                self.end_offset(topic, partition)

    def admin(self) -> AdminClient:
        """A client for administration."""
        return AdminClient({'bootstrap.servers': self.bootstrap_servers})

    def produce(self, topic: str, values: Iterable[bytes | None], **more: Any) -> None:
        """Produce records in order, and wait until all are there."""
        # One that is kept, as a new one needs half a second; another thread may have it just now.
        producer = self._producers.pop() if self._producers else self._new_producer()
        errors: list[str] = []

        def reported(error: KafkaError | None, _: Message) -> None:
            if error is not None:
                errors.append(error.str())

        for value in values:
            while True:
                try:
                    producer.produce(topic, value, on_delivery=reported, **more)
                    break
                except BufferError:
                    producer.poll(0.1)
        assert producer.flush(patient(PATIENCE_S)) == 0
        assert errors == []
        self._producers.append(producer)

    def _new_producer(self) -> Producer:
        return Producer({
            'bootstrap.servers': self.bootstrap_servers,
            'enable.idempotence': True,
            'message.max.bytes': 20_000_000,
            'reconnect.backoff.max.ms': 500,
            'log_level': 0,
        })  # fmt: skip

    def records(self, topic: str, count: int, timeout_s: float = 60.0) -> list[Message]:
        """Read a topic from its beginning until `count` records came, and a little longer."""
        config = {
            'bootstrap.servers': self.bootstrap_servers,
            'group.id': f'test-{time.monotonic_ns()}',
            'auto.offset.reset': 'earliest',
            'enable.auto.commit': False,
            'fetch.message.max.bytes': 20_000_000,
            'topic.metadata.refresh.interval.ms': 500,
        }
        found: list[Message] = []
        with contextlib.closing(Consumer(config)) as consumer:
            consumer.subscribe([topic])
            deadline = time.monotonic() + patient(timeout_s)
            while len(found) < count and time.monotonic() < deadline:
                found += [m for m in consumer.consume(1000, 0.1) if m.error() is None]
            # One too many would be a duplicate: give it the time to show.
            found += [m for m in consumer.consume(1000, 0.5) if m.error() is None]
        assert len(found) >= count, f'{topic} holds {len(found)} of {count}{gaps(found)}'
        return found

    def end_offset(self, topic: str, partition: int = 0) -> int:
        """How far a partition reaches."""
        here = TopicPartition(topic, partition)
        deadline = time.monotonic() + patient(30)
        while True:
            try:
                return self._asked(
                    'test-end',
                    lambda client, s: int(client.get_watermark_offsets(here, timeout=s)[1]),
                )
            except KafkaException:  # a topic that is new has its leader a moment later
                assert time.monotonic() < deadline, f'no leader of {topic}[{partition}]'
            time.sleep(0.1)

    def reaches(self, topic: str, offset: int, partition: int = 0) -> bool:
        """Whether a partition holds that offset or more."""
        return self.end_offset(topic, partition) >= offset

    def committed(self, group: str, topic: str, partition: int = 0) -> int:
        """The committed offset of a group; negative where there is none."""
        here = TopicPartition(topic, partition)
        return self._asked(
            group, lambda client, s: int(client.committed([here], timeout=s)[0].offset)
        )

    def close(self) -> None:
        """Let its Kafka clients go, before their broker does."""
        self._producers.clear()
        while self._clients:
            self._clients.popitem()[1].close()

    def _asked(self, group: str, question: Callable[[Consumer, float], int]) -> int:
        """Put a question to the client of a group that is kept, or else to a new one.

        One that has met a topic before its leader, or whose broker has died, may be wrong for
        long: it goes at its first error.

        Raises:
            KafkaException: A new client has got no answer.
        """
        kept = self._clients.pop(group, None)
        if kept is not None:
            with contextlib.suppress(KafkaException):
                answer = question(kept, 1.0)
                self._clients[group] = kept
                return answer
            kept.close()
        config = {
            'bootstrap.servers': self.bootstrap_servers,
            'group.id': group,
            'log_level': 0,  # that its broker is away is what some tests are about
        }
        deadline = time.monotonic() + patient(30)
        while True:
            client = Consumer(config)
            try:
                answer = question(client, 5.0)
                break
            except KafkaException:  # a broker that is new has its coordinator a moment later
                client.close()
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)
        self._clients[group] = client
        return answer
