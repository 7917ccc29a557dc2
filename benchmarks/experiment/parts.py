"""The five parts of a cell: started, given orders, ended."""

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, NamedTuple

from benchmarks.contestants import Contestant, Ends
from benchmarks.experiment.results import Usage
from benchmarks.experiment.traffic import Received, Sending, Sent, consume, produce
from benchmarks.processes import usage
from benchmarks.topics import reading
from rig.processes import ProcessError, ros_here
from ros2_kafka_bridge.demo.child import Child

_START_S: Final = 60.0
# For DDS to match what was started, and for the second that each contestant gives a subscriber.
# One that begins either with the first order only is late with it, and is to be seen.
_IDLE_S: Final = 3.0
_SEND_MORE_S: Final = 120.0
_QUIET_S: Final = 2.0
_QUIET_HOLDING_S: Final = 30.0
_END_S: Final = 20.0
_READ_S: Final = 120.0
_LOOK_S: Final = 0.1


class Place(NamedTuple):
    """Where and with what a cell is measured.

    Args:
        broker: Process id of the broker, None where it is not ours.
        domain: ROS domain.
        logs: A directory for what the parts print, by cell.
        recordings: A directory for what recordings write.
    """

    bootstrap_servers: str
    broker: int | None
    domain: int
    logs: Path
    recordings: Path


class Run:
    """The parts of a cell while they run.

    Args:
        contestant: Who carries the orders.
        ends: Between what.
        sending: What the producer sends.
        place: Where and with what.
    """

    def __init__(self, contestant: Contestant, ends: Ends, sending: Sending, place: Place) -> None:
        commands = contestant.commands(ends)
        environ = ros_here(place.domain)
        self.problems: list[str] = []
        self.sent = Sent(0, 0.0)
        self.received = Received([], [], [], [], 0)
        self._what = contestant.what
        self._ends = ends
        self._sending = sending
        self._ros_kafka = Child(
            'ros-kafka', commands.ros_to_kafka, ends.place / 'ros-kafka.log', environ
        )
        self._kafka_ros = Child(
            'kafka-ros', commands.kafka_to_ros, ends.place / 'kafka-ros.log', environ
        )
        self._subscribed = commands.subscribed
        self._children: Sequence[Child] = ()  # those that were started
        self._producer: Connection
        self._consumer: Connection
        self._broker = place.broker
        self._come = 0
        self.watched: dict[str, Watched] = {}

    def start(self, stack: ExitStack) -> None:
        """Start all parts, and let them stand idle for a while; no order goes through."""
        self._start_ends(stack, self._ends.sink)
        self._wait(lambda: self._come > 0, _START_S, 'the consumer is not ready')
        self._start_bridges(stack)
        self._wait(self._has_subscribed, _START_S, 'ros-kafka does not subscribe')
        is_read = reading(self._ends.bootstrap_servers, self._ends.source)
        self._wait(is_read, _START_S, 'nobody reads the orders')
        idle_until_s = time.monotonic() + _IDLE_S
        while time.monotonic() < idle_until_s:
            self._look()
        pids = {'kafka_ros': self._kafka_ros.pid, 'ros_kafka': self._ros_kafka.pid}
        if self._broker is not None:
            pids['broker'] = self._broker
        self.watched = {name: Watched(pid) for name, pid in pids.items()}

    def start_behind_an_order(self, stack: ExitStack) -> int:
        """Start the bridges when an order waits already; wait until it has come through.

        Returns:
            When they were started, in nanoseconds of the monotonic clock.
        """
        self._start_ends(stack, self._ends.source)
        begun_ns = time.monotonic_ns()
        self._start_bridges(stack)
        self._wait(lambda: self._come > 0, _START_S, 'not one order came through')
        return begun_ns

    def _start_ends(self, stack: ExitStack, probed: str) -> None:
        """Start producer and consumer, and send the probe to a topic."""
        servers, source, sink = self._ends.bootstrap_servers, self._ends.source, self._ends.sink
        self._consumer = stack.enter_context(_part(consume, servers, sink))
        self._producer = stack.enter_context(
            _part(produce, servers, source, probed, self._sending)
        )
        self._wait(self._producer.poll, _START_S, 'the producer is not ready')
        self._producer.recv()

    def _start_bridges(self, stack: ExitStack) -> None:
        self._children = (self._ros_kafka, self._kafka_ros)
        for child in self._children:
            stack.enter_context(child)

    def _has_subscribed(self) -> bool:
        return self._subscribed in self._ros_kafka.log.read_text(encoding='utf-8')

    def send(self) -> None:
        """Let the producer send, and wait until all have come, or nothing comes any more."""
        self._producer.send('go')
        sending_s = self._sending.total / self._sending.rate if self._sending.rate else 0.0
        self._wait(self._producer.poll, sending_s + _SEND_MORE_S, 'the producer does not end')
        self.sent = self._producer.recv()
        before, moved_s = self._moved(), time.monotonic()
        while self._come - 1 < self.sent.taken:
            self._look()
            if (now := self._moved()) != before:
                before, moved_s = now, time.monotonic()
            quiet_s = _QUIET_HOLDING_S if self._holds() else _QUIET_S
            if time.monotonic() - moved_s > quiet_s:
                break

    def end(self) -> None:
        """End the bridges, which bring what they hold to its end, and count what has come."""
        for watched in self.watched.values():
            watched.look()
        for child in self._children:
            child.ask_to_end()
        deadline_s = time.monotonic() + _END_S
        while any(child.runs for child in self._children):
            if time.monotonic() > deadline_s:
                self.problems.append(f'still running {_END_S:.0f} s after SIGTERM')
                break
            time.sleep(_LOOK_S)
        self._consumer.send('end')
        deadline_s = time.monotonic() + _READ_S
        answer: Any = None
        while not isinstance(answer, Received):
            if not self._consumer.poll(max(0.0, deadline_s - time.monotonic())):
                raise ProcessError(f'{self._ends.sink} could not be read to its end')
            answer = self._consumer.recv()
        self.received = answer

    def counted(self, child: str) -> int:
        """How many orders a bridge says that it has moved."""
        children = {'kafka_to_ros': self._kafka_ros, 'ros_to_kafka': self._ros_kafka}
        told = children[child].snapshots.get(child)
        return told.carried if told else 0

    def _wait(self, done: Callable[[], object], limit_s: float, what: str) -> None:
        deadline_s = time.monotonic() + limit_s
        while not done():
            self._look()
            if time.monotonic() > deadline_s:
                raise ProcessError(f'{self._what}: {what} within {limit_s:.0f} s')

    def _look(self) -> None:
        """Look at all parts, and rest a little."""
        for child in self._children:
            if not child.runs:
                raise ProcessError(child.story())
        while self._consumer.poll():
            self._come = self._consumer.recv()
        for watched in self.watched.values():
            watched.look()
        time.sleep(_LOOK_S)

    def _moved(self) -> tuple[int, int, int]:
        return self._come, self.counted('kafka_to_ros'), self.counted('ros_to_kafka')

    def _holds(self) -> bool:
        """Whether a bridge says that it holds messages, or has not read all that there is."""
        told = [*self._kafka_ros.snapshots.values(), *self._ros_kafka.snapshots.values()]
        return any(one.in_flight or one.lag for one in told)


class Watched:
    """A process, and what was seen of it since its first look."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._first = usage(pid)
        self._start_s = time.monotonic()
        self._last = self._first
        self._seconds: list[float] = [0.0]
        self._memory_mib: list[float] = [self._first.anon_mib]

    def look(self) -> None:
        """Note what it uses now."""
        self._last = usage(self._pid)
        self._seconds.append(round(time.monotonic() - self._start_s, 2))
        self._memory_mib.append(round(self._last.anon_mib, 2))

    def usage(self) -> Usage:
        """Sum up."""
        return Usage(
            before_mib=self._first.anon_mib,
            peak_mib=max(self._memory_mib),
            cpu_s=self._last.cpu_s - self._first.cpu_s,
            seconds=self._seconds,
            memory_mib=self._memory_mib,
        )


@contextmanager
def _part(run: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """Run a function in a process of its own; yields the connection to it."""
    spawn = multiprocessing.get_context('spawn')
    here, there = spawn.Pipe()
    process = spawn.Process(target=run, args=(there, *arguments), daemon=True)
    # Ctrl-C is for this process, which ends the part; it ignores one as soon as it can.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    process.start()
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    there.close()
    try:
        yield here
    finally:
        process.kill()
        process.join()
        here.close()
