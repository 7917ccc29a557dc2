"""Kafka's classes as Java maps them into memory: a node that has them is up in half the time.

An archive belongs to one Java and one set of jars. Another Java passes over it by itself.
"""

import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Final

from ros2_kafka_bridge.errors import BridgeError

_NAME: Final = 'classes.jsa'


def archive_flags(jars: Path) -> tuple[str, ...]:
    """Java's flags for the archive of these jars; none where there is none."""
    archive = jars / _NAME
    return (f'-XX:SharedArchiveFile={archive}',) if archive.is_file() else ()


def make_archive(jars: Path) -> None:
    """Run a node once, and keep the classes that it has loaded; without them it is only slower."""
    from ros2_kafka_bridge.testing.local_kafka import LocalKafka  # noqa: PLC0415 -- it uses this

    with tempfile.TemporaryDirectory(dir=jars.parent) as scratch:
        made = Path(scratch) / _NAME
        # What goes wrong is said by whoever needs a node.
        with suppress(BridgeError), LocalKafka(jvm_flags=(f'-XX:ArchiveClassesAtExit={made}',)):
            pass
        if made.is_file():
            made.rename(jars / _NAME)
