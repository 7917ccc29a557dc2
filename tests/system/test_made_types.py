"""Every installed type, made of its description, among nodes that have its package."""

import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from support.formats.messages import cdr_of, extremes, new_message
from support.patience import patient
from support.processes.harness import PEERS, eventually
from support.processes.terminal import finished

from ros2_kafka_bridge.message_types import load_layout, type_names
from ros2_kafka_bridge.message_types.installed import has_key

PYTHONS = {
    'kilted': Path(sys.executable),
    'jazzy': Path(__file__).parents[2] / '.venv-jazzy' / 'bin' / 'python',
}
HASHES = """\
from ros2_kafka_bridge.message_types import load_layout, type_names
for name in type_names(): print(name, load_layout(name).type_hash)
"""
QOS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# The wheels of ROS 2 have set these to their own libraries.
OWN = {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '', 'LD_LIBRARY_PATH': ''}


class Peer(NamedTuple):
    """A node's ends for one type, of its package."""

    name: str
    publisher: Any
    reader: Any
    came: list[bytes]


def same_there(python: Path) -> list[str]:
    """The types that are the same here and for another Python."""
    out = subprocess.run(
        [python, '-c', HASHES],
        env=os.environ | OWN,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=patient(60),
    ).stdout
    there = dict(line.split() for line in out.splitlines())
    return [
        name
        for name in type_names()
        if not has_key(name) and there.get(name) == load_layout(name).type_hash
    ]


@contextmanager
def echo(python: Path, names: list[str], file: Path) -> Iterator[None]:
    """A process that sends back what it takes, and has imported none of the packages for it."""
    with file.open('w+') as said:
        command = [str(python), str(PEERS / 'made_types_echo.py'), *names]
        process = subprocess.Popen(command, stdout=said, stderr=said, env=os.environ | OWN)
        try:
            eventually(lambda: 'ready' in file.read_text(), 60, file.read_text)
            yield
            assert process.poll() is None, file.read_text()
        finally:
            process.kill()
            process.wait()


@pytest.mark.parametrize('ros', PYTHONS)
def test_every_type_goes_to_a_made_one_and_comes_back_the_same(
    ros: str, ros_domain: int, tmp_path: Path
) -> None:
    names = same_there(PYTHONS[ros])
    assert len(names) > 100, names
    said = tmp_path / 'said'
    # In a process of its own: another test may start ROS in this one, with other settings.
    with (
        echo(PYTHONS[ros], names, said),
        ProcessPoolExecutor(1, get_context('spawn')) as process,
    ):
        came = process.submit(sent_and_come_back, names, ros_domain).result(patient(120))
    for name in names:
        assert came[name] == list(extremes(name)), name
    assert said.read_text() == 'ready\n'


def sent_and_come_back(names: list[str], domain: int) -> dict[str, list[bytes]]:
    """Send messages of each type, and tell what has come back of each."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node('has_all_packages', context=context)
    peers = [peer_of(node, name) for name in names]
    for peer in peers:
        for cdr in extremes(peer.name):
            peer.publisher.publish(deserialize_message(cdr, type(new_message(peer.name))))
    eventually(lambda: all([*map(has_all, peers)]), 60)
    node.destroy_node()
    context.shutdown()
    return {peer.name: peer.came for peer in peers}


def peer_of(node: Any, name: str) -> Peer:
    kind = type(new_message(name))
    publisher = node.create_publisher(kind, f'/there/{name}', QOS)
    reader = node.create_subscription(kind, f'/back/{name}', print, QOS)
    return Peer(name, publisher, reader, [])


def has_all(peer: Peer) -> bool:
    """Take what has come, as messages; tells whether that is all."""
    with peer.reader.handle:
        while taken := peer.reader.handle.take_message(peer.reader.msg_type, False):  # noqa: FBT003
            peer.came.append(cdr_of(taken[0], peer.name))
    return len(peer.came) >= len(extremes(peer.name))


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('ros', PYTHONS)
def test_a_long_churn_in_many_threads_ends(ros: str) -> None:
    done = finished(
        [PYTHONS[ros], PEERS / 'made_types_churn.py', '8', '600'],
        env=os.environ | OWN,
    )
    assert (done.stdout, done.stderr, done.returncode) == ('done\n', '', 0)
