"""A Docker engine of the tests' own, and what it builds from the Containerfile.

Its containers are in a process namespace of its own: all of them end with it, and it with the
test, however that ends. It makes no network: containers have that of the engine, or none.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import pytest
from support.processes.harness import Process, eventually
from support.processes.terminal import finished

from rig.hosts import Host

IMAGE: Final = 'ros2-kafka-bridge'
BASE: Final = 'docker.io/library/debian:trixie-slim'
# A systemd would take the numbers of processes, as they are in there, for those of its own.
_CGROUPS: Final = ('--exec-opt', 'native.cgroupdriver=cgroupfs')
_OWN: Final = ('unshare', '--mount', '--pid', '--fork', '--kill-child', '--mount-proc')
_TRUSTED: Final = '/etc/ssl/certs/ca-certificates.crt'  # of Debian
_CERTIFICATES: Final = '/etc/authorities-of-the-machine.pem'


class Engine(NamedTuple):
    """An engine that runs.

    Args:
        client: The program `docker` that came with it.
        socket: Where it answers.
    """

    client: str
    socket: Path

    @property
    def environ(self) -> dict[str, str]:
        """With which `docker`, and what calls it, finds the engine."""
        return {**os.environ, 'DOCKER_HOST': f'unix://{self.socket}', 'DOCKER_BUILDKIT': '1'}

    def asked(
        self, *words: str | Path, timeout_s: float = 120.0
    ) -> subprocess.CompletedProcess[str]:
        """Run `docker` to its end, whichever that is."""
        return finished([self.client, *words], env=self.environ, timeout_s=timeout_s)

    def docker(self, *words: str | Path, timeout_s: float = 120.0) -> str:
        """Run `docker` to a good end; returns what it prints."""
        done = self.asked(*words, timeout_s=timeout_s)
        assert done.returncode == 0, f'{words}: {done.stdout}{done.stderr}'
        return done.stdout.strip()

    def shell(self, line: str, place: Path, timeout_s: float = 300.0) -> None:
        """Run a line of a page to a good end, in a folder; its `docker` is this one's."""
        environ = self.environ
        environ['PATH'] = f'{Path(self.client).parent}:{environ["PATH"]}'
        done = finished(['sh', '-c', line], cwd=place, env=environ, timeout_s=timeout_s)
        assert done.returncode == 0, f'{line}: {done.stdout}{done.stderr}'


@contextmanager
def engine(data: Path, host: Host | None = None) -> Iterator[Engine]:
    """Run one, for as long as this lasts; else skip the test.

    Args:
        data: Where its images are; they stay.
        host: Where it runs: its containers, too, have the network of that host.
    """
    server = shutil.which('dockerd')
    if os.geteuid() or server is None:
        pytest.skip('containers cannot be run here: needs root and dockerd (docker.io)')
    client = shutil.which('docker', path=f'{Path(server).parents[1] / "bin"}') or 'docker'
    with tempfile.TemporaryDirectory(prefix='engine') as folder:  # a short path, for the socket
        place = Path(folder)
        (place / 'daemon.json').write_text('{}')
        command = [
            *_OWN, server, '--iptables=false', '--ip-forward=false', *_CGROUPS,
            f'--data-root={data}', f'--exec-root={place / "exec"}', f'--pidfile={place / "pid"}',
            f'--host=unix://{place / "socket"}', f'--config-file={place / "daemon.json"}',
        ]  # fmt: skip
        found = Engine(client, place / 'socket')
        with ExitStack() as stack:
            command.append(f'--bridge={stack.enter_context(_bridge(host))}')
            command = host.command(*command) if host else command
            process = stack.enter_context(Process(command, data.with_suffix('.log')))
            eventually(lambda: found.asked('info').returncode == 0, 60, process.output)
            yield found
            _remove(found, 'container', 'ls', '--all')
            _remove(found, 'volume', 'ls')


@contextmanager
def _bridge(host: Host | None) -> Iterator[str]:
    """Of the network that an engine has to have, and no container uses.

    With none it removes `docker0`, which on this machine may be that of another engine.
    """
    if host:
        yield 'none'
        return
    name = f'unused{os.getpid()}'
    subprocess.run(['ip', 'link', 'add', name, 'type', 'bridge'], check=True)
    try:
        yield name
    finally:
        subprocess.run(['ip', 'link', 'delete', name], check=True)


def _remove(engine: Engine, kind: str, *listing: str) -> None:
    if left := engine.docker(kind, *listing, '--quiet').split():
        engine.docker(kind, 'rm', '--force', *left)


def provide_base(engine: Engine, place: Path) -> None:
    """Have the image that the Containerfile begins with: the real one, or one of its packages.

    One that is made trusts whom this machine trusts, a company's authority for instance.
    """
    if engine.asked('pull', BASE).returncode == 0:
        return
    if shutil.which('mmdebstrap') is None:
        pytest.skip('the base of the image cannot be had here: needs mmdebstrap')
    suite = BASE.rpartition(':')[2].removesuffix('-slim')
    archive = place / 'base.tar'
    changes = []
    command: list[str | Path] = ['mmdebstrap', '--variant=minbase', suite, archive]
    if (own := Path(os.environ.get('SSL_CERT_FILE', _TRUSTED))).exists():
        changes = [
            f'--change=ENV {name}={_CERTIFICATES}' for name in ('SSL_CERT_FILE', 'PIP_CERT')
        ]
        command.insert(1, f'--customize-hook=upload {own} {_CERTIFICATES}')
    done = finished(command, timeout_s=200)
    assert done.returncode == 0, done.stderr
    engine.docker('import', *changes, archive, BASE)
    archive.unlink()
