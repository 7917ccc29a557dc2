"""Kafka's jars and the Java that runs them, for one node on this machine."""

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError

JARS_VARIABLE: Final = 'ROS2_KAFKA_BRIDGE_KAFKA_JARS'
POM: Final = Path(__file__).with_name('pom.xml')
OLDEST_JAVA: Final = 17
ARCHIVE: Final = 'classes.jsa'
"""File beside the jars: Kafka's classes as Java maps them into memory, for half the start.

It belongs to one Java and one set of jars. Another Java passes over it by itself.
"""


def find_jars(directory: Path | None = None) -> Path | None:
    """The directory that holds Kafka's jars, None where they are not installed.

    Args:
        directory: Where `install_jars` puts them. The default is what the environment variable
            ROS2_KAFKA_BRIDGE_KAFKA_JARS names, else `.kafka/jars` if there is one here, else a
            directory in the user's cache.
    """
    jars = _jars_of_this_pom(directory)
    return jars if jars.is_dir() else None


def install_jars(directory: Path | None = None) -> Path:
    """Let Maven fetch Kafka's jars, if they are not there yet; two processes may do so at once.

    `local_kafka.install_kafka` makes their archive, too.

    Args:
        directory: As in `find_jars`.

    Returns:
        The directory that holds the jars.

    Raises:
        ConfigError: Java or Maven is missing, or Maven cannot fetch the jars.
    """
    return fetch_jars(directory).directory


class Fetched(NamedTuple):
    """Jars that are here, and whether it is this call that has fetched them."""

    directory: Path
    is_new: bool


def fetch_jars(directory: Path | None = None) -> Fetched:
    """As `install_jars`; of several that wait for the jars, one is told that they are new."""
    jars = _jars_of_this_pom(directory)
    if jars.is_dir():
        return Fetched(jars, is_new=False)
    _check_tools()
    jars.parent.mkdir(parents=True, exist_ok=True)
    with (jars.parent / '.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        is_new = not jars.is_dir()
        if is_new:
            _copy_jars(jars)
    return Fetched(jars, is_new)


def archive_flags(jars: Path) -> tuple[str, ...]:
    """Java's flags for the archive of these jars; none where there is none."""
    archive = jars / ARCHIVE
    return (f'-XX:SharedArchiveFile={archive}',) if archive.is_file() else ()


def java() -> str:
    """The path of the Java that runs Kafka: that of JAVA_HOME, else the first in PATH.

    Raises:
        ConfigError: There is none, or it is too old.
    """
    home = os.environ.get('JAVA_HOME')
    found = shutil.which(f'{home}/bin/java' if home else 'java')
    if found is None:
        raise ConfigError(
            [f'no Java here (command java): Kafka needs Java {OLDEST_JAVA} or newer']
        )
    answer = subprocess.run([found, '-version'], capture_output=True, text=True, check=False)  # noqa: S603 - Java
    version = re.search(r'version "(?:1\.)?(\d+)', answer.stderr)
    if version is None or int(version[1]) < OLDEST_JAVA:
        which = f'Java {version[1]}' if version else 'of an unknown version'
        raise ConfigError([f'{found} is {which}: Kafka needs Java {OLDEST_JAVA} or newer'])
    return found


def _jars_of_this_pom(directory: Path | None) -> Path:
    # Another pom.xml means another directory: no node loses the jars that it runs from.
    version = hashlib.sha256(POM.read_bytes()).hexdigest()[:12]
    return (directory or _default_directory()).absolute() / version


def _default_directory() -> Path:
    named = os.environ.get(JARS_VARIABLE)
    if named:
        return Path(named)
    here = Path('.kafka/jars')
    if here.is_dir():
        return here
    cache = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(cache) / 'ros2-kafka-bridge' / 'kafka-jars'


def _check_tools() -> None:
    problems = []
    try:
        java()
    except ConfigError as error:
        problems += error.problems
    if shutil.which('mvn') is None:
        problems.append('no Maven here (command mvn): it fetches Kafka, once')
    if problems:
        raise ConfigError(problems)


def _copy_jars(jars: Path) -> None:
    with tempfile.TemporaryDirectory(dir=jars.parent) as scratch:
        copied = Path(scratch) / 'jars'
        maven = ['mvn', '--batch-mode', '--file', str(POM), 'dependency:copy-dependencies']
        run = subprocess.run(  # noqa: S603 - a command of this file
            [*maven, '-DincludeScope=runtime', f'-DoutputDirectory={copied}'],
            cwd=scratch,
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode:
            lines = run.stdout.splitlines()
            reason = next((line for line in lines if line.startswith('[ERROR]')), run.stderr)
            raise ConfigError([f'Maven cannot fetch Kafka: {reason}'])
        copied.rename(jars)
