"""A message whose only reader is stopped: what a middleware says of its arrival."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.helper_process import helper_process
from ros2_kafka_bridge.ros.node import RosNode, middleware
from ros2_kafka_bridge.ros.probe import MESSAGE, denies, probe_topic
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.threads.stop import Stop

_MATCHED_S: Final = 10.0  # a process that imports ROS, and its discovery, on a busy machine
# One that counts what the kernel of the reader has taken says so in this time. Less than a lease:
# of a reader that is given up, all is acknowledged.
_DENIES_S: Final = 0.5
_STEP_S: Final = 0.01
_LAST_BYTES: Final = 300
_READER: Final = 'ros2_kafka_bridge.ros.trial_reader'
_FORGOTTEN_S: Final = 0.1  # a reader that is lost is forgotten before it is reported as gone


def denies_arrival(node: RosNode, stop: Stop) -> bool | None:
    """Ask whether a message is acknowledged whose only reader is stopped.

    Returns:
        Whether the middleware denies it; None where a stop came first.

    Raises:
        RouteError: It could not be tried.
    """
    from ros2_kafka_bridge.ros.take import MatchEvents  # noqa: PLC0415 (heavy)

    topic = probe_topic()
    time_class = load_type('builtin_interfaces/msg/Time', 'import').endpoint_class
    with translated('ROS'), ExitStack() as stack:
        with node.endpoint_lock:
            publisher = node.handle.create_publisher(time_class, topic, profile(QoS()))
        stack.callback(_destroy, node, publisher)
        events = MatchEvents(publisher)
        stack.callback(events.close)
        reader = stack.enter_context(_reader(node, topic))
        if not _is_matched(reader, events, stop):
            return None
        reader.stop()
        publisher.publish(MESSAGE)
        until_s = time.monotonic() + _DENIES_S
        while (denied := denies(publisher)) and time.monotonic() < until_s:
            if stop.wait(_STEP_S):
                return None
        if denied:
            return True
        if stop.wait(_FORGOTTEN_S):
            return None
        if not reader.is_stopped or not events.look()[0]:
            raise _not_known('was lost, or went on, while it was stopped')
        return False


def _destroy(node: RosNode, publisher: Any) -> None:
    with node.endpoint_lock:
        node.handle.destroy_publisher(publisher)


class _Reader(NamedTuple):
    """A process with a subscription, and what it says."""

    process: subprocess.Popen[bytes]
    said: BinaryIO

    def stop(self) -> None:
        """Let it stand still, so that it acknowledges nothing."""
        pid = self.process.pid
        try:
            os.kill(pid, signal.SIGSTOP)
            os.waitid(os.P_PID, pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        except OSError as error:
            raise _not_known(f'could not be stopped: {error}') from error

    @property
    def is_stopped(self) -> bool:
        """Whether it stands still, for anybody may let it go on."""
        try:
            told = Path(f'/proc/{self.process.pid}/stat').read_bytes()
        except OSError:  # it has gone
            return False
        return told.rpartition(b')')[2].split()[0] == b'T'

    def last_words(self) -> str:
        """Why it has ended, as far as it has said so."""
        self.said.seek(max(0, self.said.seek(0, os.SEEK_END) - _LAST_BYTES))
        lines = self.said.read().decode(errors='replace').splitlines()
        return printable(lines[-1]) if lines else f'exit status {self.process.returncode}'


def _is_matched(reader: _Reader, events: Any, stop: Stop) -> bool:
    """Wait for the match; False where a stop came first."""
    until_s = time.monotonic() + _MATCHED_S
    while not events.look()[0]:
        if stop.wait(_STEP_S):
            return False
        if reader.process.poll() is not None:
            raise _not_known(f'has ended: {reader.last_words()}')
        if time.monotonic() > until_s:
            raise _not_known(
                f'was not discovered within {_MATCHED_S:g} s (two processes of this machine have '
                'to find each other: ROS_AUTOMATIC_DISCOVERY_RANGE, multicast; on Zenoh a router)'
            )
    return True


def _not_known(why: str) -> RouteError:
    return RouteError(
        f'it is not known whether {middleware()} tells what has arrived: the reader that was to '
        f'show it {why}. To run without knowing: ros: {{confirmation: none}}'
    )


@contextmanager
def _reader(node: RosNode, topic: str) -> Iterator[_Reader]:
    """Start a subscription in a process of its own, which ends with this one."""
    name = f'{node.handle.get_name()}_trial'
    options = [name, topic, str(node.domain_id), str(os.getpid())]
    with ExitStack() as stack:
        try:
            said = stack.enter_context(os.fdopen(os.memfd_create('said'), 'w+b'))  # no folder
            process = stack.enter_context(
                helper_process(
                    _READER, options, stdin=subprocess.DEVNULL, stdout=said, stderr=said
                )
            )
        except OSError as error:
            raise _not_known(f'could not be started: {error}') from error
        yield _Reader(process, said)
