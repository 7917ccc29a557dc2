"""What a measurement was made on, and with."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import confluent_kafka
from rich.console import Console

from ros2_kafka_bridge.testing.kafka_jars import find_jars


class Machine(NamedTuple):
    """Cores that may be used, processor, and memory."""

    cores: int
    cpu: str
    memory_gib: float


def machine() -> Machine:
    """Look at this machine."""
    models = [
        line.partition(':')[2].strip()
        for line in Path('/proc/cpuinfo').read_text().splitlines()
        if line.startswith('model name')
    ]
    pages = os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE')
    model = models[0] if models else platform.machine()
    return Machine(len(os.sched_getaffinity(0)), model, round(pages / 2**30, 1))


def versions(*, is_local_kafka: bool) -> dict[str, str]:
    """Say which versions take part."""
    return {
        'python': platform.python_version(),
        'confluent-kafka': _version('confluent-kafka'),
        'librdkafka': confluent_kafka.libversion()[0],
        'rclpy': _version('rclpy'),
        'kafka': _local_kafka() if is_local_kafka else 'not ours',
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return f'of the sourced ROS ({os.environ.get("ROS_DISTRO", "unknown")})'


def _local_kafka() -> str:
    jars = find_jars()
    found = sorted(jars.glob('kafka-clients-*.jar')) if jars else []
    return found[0].stem.removeprefix('kafka-clients-') if found else 'unknown'


def show_machine(report: dict[str, Any], console: Console) -> None:
    """Print where it was measured."""
    here = report['machine']
    console.print(f'{here["cores"]} cores of {here["cpu"]}, {here["memory_gib"]} GiB')
    console.print(', '.join(f'{name} {number}' for name, number in report['versions'].items()))
