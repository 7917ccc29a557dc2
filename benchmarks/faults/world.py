"""All that runs during a run: Kafka, the bridge, publishers, subscribers, and what they tell."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from ruamel.yaml import YAML

from benchmarks.faults import journal, kafka, said
from benchmarks.faults.checker import Ends, Seen
from benchmarks.faults.journal import Entry
from benchmarks.faults.parts import end
from benchmarks.faults.progress import Progress
from benchmarks.faults.setting import Setting
from benchmarks.faults.streams import SUBSCRIBER_CACHE, Stream, configuration
from rig.hosts import Hosts
from rig.local_cluster import LocalCluster
from rig.processes import Process, ProcessError, Programs, ros_here
from ros2_kafka_bridge.ros.fastdds_profile import FASTDDS_3, Histories, make_profile
from ros2_kafka_bridge.testing.kafka_node import HOST

START_S: Final = 90.0
SPOOLS: Final = 'spools'
DRAIN_S: Final = 30.0
_LOOK_S: Final = 0.05
PUBLISHER_HISTORY: Final = 5000
HAND_OVER_NS: Final = 15_000_000_000
"""How long two bridges may read the same publisher, while one takes over from the other."""
_PEER: Final = 'benchmarks.faults.peers'


class World:
    """The parts of a run, for faults to be done to them.

    Args:
        setting: What it is made with.
        cluster: Kafka, running.
        stop: Is set when somebody wants the run to end.
    """

    def __init__(self, setting: Setting, cluster: LocalCluster, stop: threading.Event) -> None:
        self.setting = setting
        self.cluster = cluster
        self.stop = stop
        self.place = setting.place
        self.spools = setting.place / SPOOLS
        self.config_file = self._write_config()
        robot, edge, _ = setting.hosts or (None, None, None)
        logs, ros = self.place / 'logs', ros_here(setting.domain)  # a host has its own range
        self._here = Programs(logs, {})
        self._robot = Programs(logs, ros, robot)
        self._edge = Programs(logs, ros, edge)
        self.bridges = [self.make_bridge(f'bridge-{n}') for n in range(setting.bridges)]
        self.extra: list[Process] = []
        self.away_ns: tuple[int, int] | None = None  # when no bridge took from publishers
        self.publishers: dict[str, Process] = {}
        self.progress: dict[str, Progress] = {}
        self._peers: list[Process] = []
        for stream in setting.streams:
            arrived = self.place / 'journals' / 'arrived' / stream.kafka_topic
            self.progress[stream.name] = Progress(stream, self._sent(stream), arrived)
            if stream.is_from_kafka:
                self._producer(stream)
                self.subscriber = self._subscriber(stream)
            else:
                self.publishers[stream.name] = self._publisher(stream)
        if self.publishers:
            self._recorder()

    # Parts

    def make_bridge(self, name: str, *options: str) -> Process:
        """A bridge that runs the file of all, not started."""
        return self._edge.bridge(name, self.config_file, *options)

    @property
    def hosts(self) -> Hosts:
        """Its hosts."""
        assert self.setting.hosts is not None, 'a fault of the network needs hosts'
        return self.setting.hosts

    def start_publisher(self, name: str) -> int:
        """Start a publisher, which goes on with its numbering; returns when."""
        self.look()
        first = self.progress[name].last_sent + 1
        return self.publishers[name].start('--first', str(first))

    def tell(self, stream: str, command: str) -> None:
        """Tell the sender of a stream what to do."""
        with self._commands(stream).open('a') as file:
            file.write(f'{command}\n')

    # How it goes

    def look(self) -> None:
        """See how far the streams have come."""
        for progress in self.progress.values():
            progress.look()

    def check(self) -> None:
        """See that all runs that should run.

        Raises:
            ProcessError: Something does not.
        """
        for part in (*self.bridges, *self.publishers.values(), *self._peers):
            part.check()

    def settle(self, timeout_s: float) -> list[str]:
        """Wait until what is sent from now on comes; returns streams that do not flow."""
        self.look()
        before = {name: progress.last_sent for name, progress in self.progress.items()}
        marks: dict[str, list[int]] = {}

        def flows(name: str) -> bool:
            progress = self.progress[name]
            if name not in marks and progress.last_sent > before[name]:
                marks[name] = progress.marks()
            return name in marks and progress.has_reached(marks[name])

        return self._wait_for_each(list(before), flows, time.monotonic() + timeout_s)

    def says(self, stream: str) -> list[str]:
        """What each bridge has said last of the route of a stream."""
        return [f'{log.stem}: {said.last_of(stream, _lines(log))}' for log in self._bridge_logs()]

    def _arrive(self, names: list[str], deadline_s: float) -> list[str]:
        """Wait until what was sent by now has come, or what was sent behind it."""
        self.look()
        marks = {name: self.progress[name].marks() for name in names}

        def has_come(name: str) -> bool:
            return self.progress[name].has_reached(marks[name])

        return self._wait_for_each(names, has_come, deadline_s)

    def _wait_for_each(
        self, names: list[str], condition: Callable[[str], bool], deadline_s: float
    ) -> list[str]:
        """Wait until a condition holds for each stream; returns those for which it does not."""
        left = names
        while (left := [n for n in left if not condition(n)]) and time.monotonic() < deadline_s:
            time.sleep(_LOOK_S)
            self.check()
            self.look()
        return left

    def pause(self, seconds: float) -> None:
        """Let time go by; the end of the run cuts it short."""
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0 and not self.stop.is_set():
            time.sleep(min(_LOOK_S, left_s))
            self.check()

    def wait_until_subscribed(self, bridge: Process, from_place: int) -> None:
        """Wait until a bridge says that it has subscribed to every VOLATILE publisher.

        The others can wait with what they have: before it is read, Kafka has to be asked what it
        holds of that.

        Args:
            bridge: Which.
            from_place: Where in its log it began to speak in this life.

        Raises:
            ProcessError: It does not.
        """

        def is_subscribed() -> bool:
            said = bridge.log.read_text()[from_place:]
            return all(
                f'subscribes to {stream.ros_topic} (reliable, volatile)' in said
                for stream in self.setting.streams
                if stream.durability == 'volatile'
            )

        self._wait('the bridge subscribes', is_subscribed)

    # From the beginning to the end

    def start(self) -> None:
        """Start all, and wait until every stream flows.

        Raises:
            ProcessError: One does not.
        """
        for stream in self.setting.streams:
            kafka.create_topics(self.cluster, stream)
        for bridge in self.bridges:
            bridge.start()
        for part in self._peers:
            part.start()
        for name in self.publishers:
            self.start_publisher(name)
        self._wait('every stream flows', lambda: all(p.count for p in self.progress.values()))

    def finish(self) -> list[str]:
        """End the sending and wait for what is on its way; returns streams that do not flow."""
        for stream in self.setting.streams:
            self.tell(stream.name, 'enough')
        time.sleep(1.0)
        late = self._arrive(list(self.progress), time.monotonic() + DRAIN_S)
        time.sleep(2.0)  # what comes twice shall show
        self.look()
        return late

    def end(self) -> list[int | None]:
        """End every process, the bridges in order; returns their exit statuses.

        None says that one was never started, or had to be killed.
        """
        for part in self.extra:
            end(part, DRAIN_S)
        statuses = [end(bridge, DRAIN_S) for bridge in self.bridges]
        for part in (*self.publishers.values(), *self._peers):
            part.kill()
        return statuses

    def kill(self) -> None:
        """End every process at once."""
        for part in (*self.extra, *self.bridges, *self.publishers.values(), *self._peers):
            part.kill()

    def ends(self, stream: Stream) -> tuple[Ends, list[kafka.Kept]]:
        """What came of a stream: for the checker, and the records, where it ends in Kafka."""
        progress = self.progress[stream.name]
        entries = journal.read(progress.sent_file)
        records: list[kafka.Kept] = []
        if stream.is_from_kafka:
            came = [e for e in journal.read(progress.arrived_file) if e.mark == journal.ARRIVED]
            arrived = [Seen(entry.number, entry.time_ns) for entry in came]
        else:
            records = kafka.arrived(self.cluster.bootstrap_servers, stream)
            arrived = [Seen(r.number, r.time_ns) for r in records if r.number is not None]
        letters = kafka.dead_lettered(self.cluster.bootstrap_servers, stream, records)
        return Ends(
            _marked(entries, journal.SENT),
            _marked(entries, journal.HOSTILE),
            journal.uncounted(entries, is_from_kafka=stream.is_from_kafka),
            arrived,
            letters,
            stream.lines,
        ), records

    def hand_overs_ns(self, stream: Stream) -> list[int]:
        """When a stream went from one bridge to another, by what they said.

        That is Kafka's decision, and comes also where a machine is too busy to be heard of for
        the time of a session.
        """
        lines = (line for log in self._bridge_logs() for line in _lines(log))
        return said.hand_overs_ns(stream.name, lines, is_from_kafka=stream.is_from_kafka)

    def _bridge_logs(self) -> list[Path]:
        return sorted((self.place / 'logs').glob('bridge*.log'))

    def _wait(self, what: str, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + START_S
        while not condition():
            if time.monotonic() > deadline_s:
                counts = {name: progress.count for name, progress in self.progress.items()}
                raise ProcessError(f'not within {START_S:.0f} s: {what} {counts}')
            time.sleep(_LOOK_S)
            self.check()
            self.look()

    # How parts are made

    def _producer(self, stream: Stream) -> None:
        servers = '--bootstrap-servers', self.cluster.bootstrap_servers
        options = *servers, '--partitions', str(stream.lines)
        self._peer(
            self._here, 'kafka_producer', *self._sender(stream.kafka_topic, stream), *options
        )

    def _subscriber(self, stream: Stream) -> Process:
        profile = self._profile('subscriber', Histories({}, {stream.ros_topic: SUBSCRIBER_CACHE}))
        arguments = [stream.ros_topic, str(self.progress[stream.name].arrived_file)]
        return self._peer(self._robot, 'ros_subscriber', *arguments, **profile)

    def _publisher(self, stream: Stream) -> Process:
        assert stream.durability is not None
        history = Histories({stream.ros_topic: PUBLISHER_HISTORY}, {})
        command = '-m', f'{_PEER}.ros_publisher', *self._sender(stream.ros_topic, stream)
        options = '--durability', stream.durability
        profile = self._profile(stream.name, history)
        return self._robot.python(f'publisher-{stream.name}', *command, *options, **profile)

    def _recorder(self) -> None:
        topics = [stream.kafka_topic for stream in self.setting.streams if stream.durability]
        place = self.place / 'journals' / 'arrived'
        arguments = [self.cluster.bootstrap_servers, str(place), *topics]
        self._peer(self._here, 'kafka_recorder', *arguments)

    def _peer(self, at: Programs, name: str, *arguments: str, **environ: str) -> Process:
        part = at.python(name, '-m', f'{_PEER}.{name}', *arguments, **environ)
        self._peers.append(part)
        return part

    def _sender(self, topic: str, stream: Stream) -> Sequence[str]:
        files = str(self._sent(stream)), str(self._commands(stream.name))
        return topic, *files, f'--rate={self.setting.rate}', f'--seed={self.setting.seed}'

    def _profile(self, name: str, histories: Histories) -> dict[str, str]:
        """With a quick heartbeat: what is acknowledged is known at once."""
        file = self.place / f'{name}.xml'
        file.write_text(make_profile(histories))
        return {FASTDDS_3.variable: str(file)}

    def _write_config(self) -> Path:
        file = self.place / 'bridge.yaml'
        servers = self.cluster.bootstrap_servers
        is_exclusive = self.setting.bridges > 1
        content = configuration(
            servers,
            self.setting.streams,
            self.spools,
            self.setting.membership,
            is_exclusive=is_exclusive,
        )
        with file.open('w') as opened:
            YAML(typ='safe').dump(content, opened)
        return file

    def _sent(self, stream: Stream) -> Path:
        return self.place / 'journals' / 'sent' / stream.kafka_topic

    def _commands(self, stream: str) -> Path:
        return self.place / 'journals' / 'commands' / stream


@contextmanager
def running(setting: Setting, stop: threading.Event) -> Iterator[World]:
    """Start all of a run, and end what still runs of it."""
    for part in ('logs', 'journals/sent', 'journals/arrived', 'journals/commands'):
        (setting.place / part).mkdir(parents=True)
    host = setting.hosts.site.address if setting.hosts else HOST
    with LocalCluster(setting.brokers, host, setting.membership.broker) as cluster:
        world = World(setting, cluster, stop)
        try:
            world.start()
            yield world
        except KeyboardInterrupt:
            world.kill()
            raise
        finally:
            world.end()


def _lines(log: Path) -> list[str]:
    return log.read_text().splitlines()


def _marked(entries: Sequence[Entry], mark: str) -> list[Seen]:
    return [Seen(entry.number, entry.time_ns) for entry in entries if entry.mark == mark]
