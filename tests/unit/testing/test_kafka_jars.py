"""Kafka for tests: fetched once, and mapped into memory once, by whoever comes first."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from rig.local_cluster import LocalCluster
from ros2_kafka_bridge.testing import kafka_jars, kafka_node, local_kafka


@pytest.fixture
def archived(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Where an archive was made, in turn; neither Maven nor Kafka runs."""
    made: list[Path] = []
    monkeypatch.setattr(kafka_jars, '_check_tools', lambda: None)
    monkeypatch.setattr(kafka_jars, '_copy_jars', Path.mkdir)
    monkeypatch.setattr(local_kafka, 'make_archive', made.append)
    return made


def test_of_several_that_begin_at_once_one_makes_the_archive(
    archived: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    all_have_looked = Barrier(3)
    monkeypatch.setattr(kafka_jars, '_check_tools', lambda: all_have_looked.wait(10))
    with ThreadPoolExecutor(3) as threads:
        (jars,) = set(threads.map(local_kafka.install_kafka, [tmp_path] * 3))
    assert archived == [jars]


class BegunError(Exception):
    """A node was to be started."""


def test_a_cluster_makes_the_archive_too(
    archived: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(node: kafka_node.KafkaNode, *_: object) -> None:
        raise BegunError(node.directory)

    monkeypatch.setenv(kafka_jars.JARS_VARIABLE, str(tmp_path))
    monkeypatch.setattr(kafka_node.KafkaNode, 'start', start)
    with pytest.raises(BegunError), LocalCluster():
        pass
    assert archived == [kafka_jars.find_jars()]
