"""A real Schema Registry on this machine: Apicurio Registry, which speaks Confluent's protocol.

Confluent's own is not on Maven Central. Maven fetches this one once, 109 MB; it keeps its schemas
in memory, and is up in about four seconds.
"""

import fcntl
import os
import shutil
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from support.processes.terminal import finished

from rig.processes import Process
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.testing.kafka_jars import JARS_VARIABLE, java
from ros2_kafka_bridge.testing.kafka_node import HOST, free_port

VERSION: Final = '3.0.9'  # the last one that runs on Java 17
_ARTIFACT: Final = f'io.apicurio:apicurio-registry-app:{VERSION}:tar.gz:all'
_UNPACK: Final = 'org.apache.maven.plugins:maven-dependency-plugin:3.9.0:unpack'
_START_S: Final = 120.0


class NoRegistryError(Exception):
    """It cannot be had on this machine."""


@contextmanager
def local_registry() -> Iterator[str]:
    """Run one, and give its URL.

    Raises:
        NoRegistryError: Java or Maven is missing, or Maven cannot fetch it.
    """
    try:
        java_path = java()
    except ConfigError as error:
        raise NoRegistryError(str(error)) from None
    jar = _install() / f'apicurio-registry-app-{VERSION}-runner.jar'
    port = free_port()
    flags = [f'-Dquarkus.http.host={HOST}', f'-Dquarkus.http.port={port}']
    command = [java_path, '-Xmx512m', '-XX:TieredStopAtLevel=1', *flags, '-jar', str(jar)]
    with (
        tempfile.TemporaryDirectory() as place,
        Process(command, Path(place, 'registry.log'), grace_s=30) as process,
    ):
        url = f'http://{HOST}:{port}/apis/ccompat/v7'
        _wait(process, url)
        yield url


def _install() -> Path:
    """The directory of its files, which Maven fetches if they are not there yet."""
    jars = os.environ.get(JARS_VARIABLE)
    place = (Path(jars).parent if jars else Path('.kafka')).absolute() / f'registry-{VERSION}'
    if place.is_dir():
        return place
    if shutil.which('mvn') is None:
        raise NoRegistryError('no Maven here (command mvn): it fetches a Schema Registry, once')
    place.parent.mkdir(parents=True, exist_ok=True)
    with (place.parent / '.registry-lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not place.is_dir():
            _fetch(place)
    return place


def _fetch(place: Path) -> None:
    with tempfile.TemporaryDirectory(dir=place.parent) as scratch:
        maven = ['mvn', '--batch-mode', _UNPACK, f'-Dartifact={_ARTIFACT}']
        run = finished([*maven, f'-DoutputDirectory={scratch}/files'], timeout_s=600, cwd=scratch)
        if run.returncode:
            lines = run.stdout.splitlines()
            reason = next((line for line in lines if line.startswith('[ERROR]')), run.stderr)
            raise NoRegistryError(f'Maven cannot fetch {_ARTIFACT}: {reason}')
        Path(scratch, 'files').rename(place)


def _wait(process: Process, url: str) -> None:
    deadline = time.monotonic() + _START_S
    while True:
        try:
            with urllib.request.urlopen(f'{url}/subjects', timeout=5):  # noqa: S310 -- our own
                return
        except OSError:
            process.check()
            assert time.monotonic() < deadline, process.output()
            time.sleep(0.1)
