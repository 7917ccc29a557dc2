"""Hosts on a network that can be cut and made to lose packets, all on this machine.

Each host is a network of its own in the Linux kernel (a namespace), with its own /dev/shm, as
ROS 2 nodes on one machine talk through shared memory. A switch joins them. Nothing has a name on
this machine, so that any number of networks can be there at once; all of it, the processes too,
ends with the program that made it, however that ends. It takes root.

    with Network('robot', 'site') as (robot, site):
        with site.entered():
            kafka = LocalKafka(host=site.address)
            kafka.start()
        subprocess.Popen(robot.command('ros2-kafka-bridge', 'run', 'bridge.yaml'))
        robot.unplug()
        robot.plug_in()
        robot.lose(0.05, 'udp')
"""

import ctypes
import os
import select
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, NamedTuple

from ros2_kafka_bridge.errors import ConfigError

PROGRAMS: Final = ('ip', 'nsenter', 'tc', 'unshare')
SUBNET: Final = '10.98.76'
END_S: Final = 10.0
BEGIN_S: Final = 60.0

Traffic = Literal['tcp', 'udp', 'all']

_NEW_NETWORK: Final = 0x4000_0000  # CLONE_NEWNET
_PROTOCOLS: Final = {'tcp': 6, 'udp': 17}

# What is in a host lives no longer than this: its standard input ends with the owner, whose
# number is the first argument.
_HOLD: Final = """
mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready
read -r _
here=$(readlink /proc/self/ns/net)
for process in /proc/[0-9]*; do
    pid=${process#/proc/}
    [ "$pid" = $$ ] || [ "$pid" = "$1" ] && continue
    [ "$(readlink "$process/ns/net")" = "$here" ] && kill -9 "$pid"
done
"""


class Host:
    """One host of a `Network`, which makes it.

    Args:
        name: For people, in errors.
        address: Where the others reach it.
    """

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        self.address = address
        self._space = _Namespace()
        self._port = ''
        self._switch: _Namespace | None = None

    def command(self, *command: str) -> list[str]:
        """What to start to have a command run in this host, in the same directory as here.

        The process that is started becomes the command, so that signals reach it. ROS 2 looks
        for others in the whole network there.
        """
        into_place = 'cd -- "$0" && exec "$@"'
        return [
            *self._space.command(),
            *('env', 'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET'),
            *('sh', '-c', into_place, str(Path.cwd()), *command),
        ]

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Put the calling thread into this host's network for a while.

        Sockets that it opens, threads and processes that it starts (a Kafka client, `LocalKafka`)
        are there and stay there. The file system, with /dev/shm, is that of the caller still.
        """
        with self._space.entered():
            yield

    def unplug(self) -> None:
        """Cut the host off: its link goes down, as it does when somebody pulls the cable."""
        self._on_its_port('ip', 'link', 'set', self._port, 'down')

    def plug_in(self) -> None:
        """Undo `unplug`."""
        self._on_its_port('ip', 'link', 'set', self._port, 'up')

    def lose(self, share: float, traffic: Traffic = 'all') -> None:
        """From now on lose packets at random, to this host and from it.

        Args:
            share: How many of them, between 0 (no more) and 1 (the link is up, but dead).
            traffic: Which.

        Raises:
            ConfigError: The kernel cannot do it.
        """
        has_rule = bool(self._on_its_port('tc', 'filter', 'show', 'dev', self._port, 'ingress'))
        if has_rule:
            self._on_its_port('tc', 'qdisc', 'del', 'dev', self._port, 'clsact')
        if not share:
            return
        self._on_its_port('tc', 'qdisc', 'add', 'dev', self._port, 'clsact')
        rule = ('protocol', 'ip', 'bpf', 'direct-action', 'bytecode', _lossy(share, traffic))
        for way in ('ingress', 'egress'):
            self._on_its_port('tc', 'filter', 'add', 'dev', self._port, way, *rule)

    def join(self, switch: '_Namespace', port: str) -> None:
        """Plug the host into a switch; the network does this.

        Raises:
            ConfigError: The kernel cannot do it.
        """
        self._switch, self._port = switch, port
        mine = f'/proc/{self._space.pid}/ns/net'
        link = ('link', 'add', port, 'type', 'veth', 'peer', 'name', 'eth0')
        switch.run('ip', *link, 'netns', mine)
        switch.run('ip', 'link', 'set', port, 'master', 'switch')
        switch.run('ip', 'link', 'set', port, 'up')
        self._space.run('ip', 'address', 'add', f'{self.address}/24', 'dev', 'eth0')
        self._space.run('ip', 'link', 'set', 'eth0', 'up')

    def open(self) -> None:
        """Make the host's network; the network does this.

        Raises:
            ConfigError: This user may not, or the kernel cannot.
        """
        self._space.open()

    def close(self) -> None:
        """End all processes in the host, and the host."""
        self._space.close()

    def _on_its_port(self, *command: str) -> str:
        assert self._switch is not None, f'{self.name} is in no network'
        return self._switch.run(*command)


class Network:
    """Hosts and the switch between them.

    Args:
        names: Of the hosts, for people.
    """

    def __init__(self, *names: str) -> None:
        self.hosts = tuple(
            Host(name, f'{SUBNET}.{number}') for number, name in enumerate(names, 1)
        )
        self._stack = ExitStack()

    def __enter__(self) -> tuple[Host, ...]:
        """Make the network.

        Raises:
            ConfigError: This user may not, a program is missing, or the kernel cannot.
        """
        _check()
        with ExitStack() as stack:
            switch = _Namespace()
            switch.open()
            stack.callback(switch.close)
            bridge = ('link', 'add', 'switch', 'type', 'bridge', 'mcast_snooping', '0')
            switch.run('ip', *bridge)
            switch.run('ip', 'link', 'set', 'switch', 'up')
            for number, host in enumerate(self.hosts):
                host.open()
                stack.callback(host.close)
                host.join(switch, f'port{number}')
            self._stack = stack.pop_all()
        return self.hosts

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()


class Hosts(NamedTuple):
    """Three hosts: the robot with the ROS nodes, the edge with the bridge, the site with Kafka."""

    robot: Host
    edge: Host
    site: Host


class _Namespace:
    """A network and a file system of one's own, held by a process that waits in them."""

    def __init__(self) -> None:
        self._holder: subprocess.Popen[str] | None = None

    @property
    def pid(self) -> int:
        """The process that holds it."""
        assert self._holder is not None, 'the network is not there'
        return self._holder.pid

    def open(self) -> None:
        """Make it.

        Raises:
            ConfigError: This user may not.
        """
        new = ('unshare', '--net', '--mount', '--propagation', 'private')
        self._holder = subprocess.Popen(  # noqa: S603 - a command of this file
            [*new, 'sh', '-c', _HOLD, 'sh', str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # Ctrl-C is for the owner
        )
        assert self._holder.stdout is not None
        said = select.select([self._holder.stdout], [], [], BEGIN_S)[0]
        answer = self._holder.stdout.readline().strip() if said else 'no answer'
        if answer != 'ready':
            self.close()
            raise ConfigError([f'no network of its own can be made here: {answer}'])

    def close(self) -> None:
        """End it, and all processes in it."""
        if self._holder is not None:
            self._holder.communicate(timeout=END_S)
            self._holder = None

    def command(self) -> Sequence[str]:
        """What to put before a command to have it run there."""
        return 'nsenter', '--target', str(self.pid), '--net', '--mount', '--'

    def run(self, *command: str) -> str:
        """Run a command there, which is root's.

        Raises:
            ConfigError: It failed.
        """
        done = subprocess.run(  # noqa: S603 - a command of this file
            [*self.command(), *command],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            timeout=BEGIN_S,
        )
        if done.returncode:
            said = ' '.join(done.stderr.split())
            raise ConfigError([f'the kernel refuses `{" ".join(command)}`: {said}'])
        return done.stdout

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Put the calling thread there for a while."""
        before = os.open('/proc/thread-self/ns/net', os.O_RDONLY | os.O_CLOEXEC)
        try:
            there = os.open(f'/proc/{self.pid}/ns/net', os.O_RDONLY | os.O_CLOEXEC)
            try:
                _enter(there)
            finally:
                os.close(there)
            try:
                yield
            finally:
                _enter(before)
        finally:
            os.close(before)


def _enter(network: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(network, _NEW_NETWORK):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _check() -> None:
    problems = [
        f'no command {name} here: networks of its own need it (Debian: iproute2, util-linux)'
        for name in PROGRAMS
        if shutil.which(name) is None
    ]
    if os.geteuid():
        problems.append('networks of its own take root')
    if problems:
        raise ConfigError(problems)


def _lossy(share: float, traffic: Traffic) -> str:
    """A program for the kernel's packet filter that drops a share of the packets of a kind.

    The usual tools for it (netem, iptables) are missing in many kernels; this filter is not.
    """
    load_byte, load_word, is_equal, is_above, answer = 48, 32, 21, 37, 6
    protocol_at, random_number, pass_on, drop = 23, 0xFFFF_F038, 0xFFFF_FFFF, 2
    last_lost = min(int(share * 2**32), 2**32 - 1)
    # An instruction: what to do, how many to jump over if so, and if not, with what.
    program = [
        (load_word, 0, 0, random_number),
        (is_above, 1, 0, last_lost),
        (answer, 0, 0, drop),
        (answer, 0, 0, pass_on),
    ]
    if traffic != 'all':
        to_the_end = len(program) - 1
        program[:0] = [
            (load_byte, 0, 0, protocol_at),
            (is_equal, 0, to_the_end, _PROTOCOLS[traffic]),
        ]
    steps = [' '.join(str(number) for number in step) for step in program]
    return ','.join([str(len(steps)), *steps])
