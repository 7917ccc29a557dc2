"""Hosts of a network in the kernel: apart, joined, cut, and gone without a trace. Takes root."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from support.processes.harness import eventually

from rig.hosts import Host, Network
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.testing.kafka_node import free_port

PORT = 5000
PACKETS = 200  # as many as a socket keeps until they are read

ABANDON = """
import os, subprocess
from rig.hosts import Network
with Network('robot') as (robot,):
    inside = subprocess.Popen(robot.command('sleep', '1000'))
    print(inside.pid, flush=True)
    os.kill(os.getpid(), 9)
"""


@pytest.fixture
def network() -> Iterator[Network]:
    """A robot and a site, joined."""
    network = Network('robot', 'site')
    try:
        with network as (robot, site):
            eventually(lambda: arrive(robot, site) == 1, 20)  # the kernel takes a moment
            yield network
    except ConfigError as reason:
        pytest.skip(str(reason))


def arrive(sender: Host, receiver: Host, count: int = 1) -> int:
    """How many of some packets (UDP) arrive."""
    with receiver.entered():
        here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with sender.entered():
        there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with here, there:
        here.bind((receiver.address, PORT))
        # Where the kernel has just asked for the address in vain, a packet waits up to a second.
        here.settimeout(2)
        for _ in range(count):
            there.sendto(b'x', (receiver.address, PORT))
        found = 0
        with suppress(TimeoutError):
            while found < count and here.recv(10):
                found += 1
        return found


def test_a_host_that_is_unplugged_is_out_of_reach_until_it_is_plugged_in(network: Network) -> None:
    robot, site = network.hosts
    assert arrive(robot, site) == arrive(site, robot) == 1
    robot.unplug()
    assert arrive(robot, site) == arrive(site, robot) == 0
    robot.plug_in()
    eventually(lambda: arrive(robot, site) == arrive(site, robot) == 1, 20)


def test_packets_of_the_kind_that_was_asked_for_are_lost_both_ways(network: Network) -> None:
    robot, site = network.hosts
    robot.lose(0.5, 'udp')
    assert PACKETS * 0.3 < arrive(robot, site, PACKETS) < PACKETS * 0.7
    assert PACKETS * 0.3 < arrive(site, robot, PACKETS) < PACKETS * 0.7
    robot.lose(1.0, 'tcp')
    assert arrive(robot, site) == 1
    robot.lose(1.0)
    assert arrive(robot, site) == 0
    robot.lose(0.0)
    assert arrive(robot, site, PACKETS) == PACKETS


def test_two_networks_with_the_same_addresses_do_not_meet(network: Network) -> None:
    robot, site = network.hosts
    with Network('robot', 'site') as (_, other):
        with other.entered():
            receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with receiver:
            receiver.bind((other.address, PORT))
            receiver.settimeout(0.3)
            assert other.address == site.address
            assert arrive(robot, site) == 1
            with pytest.raises(TimeoutError):
                receiver.recv(10)


def test_a_command_runs_there_with_its_own_shared_memory_and_the_directory_of_here(
    network: Network,
) -> None:
    robot, _ = network.hosts
    script = 'ip -brief address show eth0; ls /dev/shm; pwd'
    said = subprocess.check_output(robot.command('sh', '-c', script), text=True, timeout=60)
    address, directory = said.splitlines()
    assert f'{robot.address}/24' in address
    assert directory == str(Path.cwd())


def test_the_address_of_a_host_is_none_outside(network: Network) -> None:
    robot, _ = network.hosts
    with pytest.raises(ConfigError, match=f'{robot.address} is no address of this machine'):
        free_port(robot.address)


def test_a_network_ends_with_what_runs_in_it(network: Network) -> None:
    """And the program that made it, which may have been in there, does not."""
    with Network('robot') as (robot,), robot.entered():
        process = subprocess.Popen(['sleep', '1000'])
    assert process.wait(10) == -signal.SIGKILL
    assert network.hosts


def test_nothing_is_left_of_a_network_whose_program_was_killed(network: Network) -> None:
    assert network.hosts
    run = subprocess.run(
        [sys.executable, '-c', ABANDON],
        cwd=Path(__file__).parents[2],  # where `rig` is found
        stdout=subprocess.PIPE,
        check=False,
        timeout=60,
    )
    assert run.returncode == -signal.SIGKILL
    inside = Path(f'/proc/{int(run.stdout)}')
    eventually(lambda: not inside.exists() or 'Z' in _state(inside), 20)


def _state(process: Path) -> str:
    try:
        return (process / 'stat').read_text().rpartition(')')[2].split()[0]
    except OSError:
        return 'Z'


def test_without_root_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, 'geteuid', lambda: 1000)
    with pytest.raises(ConfigError, match='networks of its own take root'), Network('robot'):
        pass


def test_a_missing_program_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('PATH', '')
    with pytest.raises(ConfigError, match='no command nsenter here'), Network('robot'):
        pass
