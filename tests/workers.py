"""What tests of several workers share: which processes they are, whether they are gone."""

import re
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from harness import Bench, Process, eventually, to_kafka, to_ros


def there_and_back(kafka: str, **more: Any) -> list[dict[str, Any]]:
    """Two routes, Kafka -> ROS -> Kafka, into a topic `.returned`."""
    return [to_ros(kafka, '/orders', **more), to_kafka('/orders', f'{kafka}.returned')]


def bridge(bench: Bench, config: Path) -> Process:
    """Start a bridge with workers, and wait until both routes run."""
    with ExitStack() as stack:
        process = stack.enter_context(bench.bridge(config))
        process.wait_for('subscribes to', 60)
        process.wait_for('reads ', 60)
        stack.pop_all()
    return process


def pids(process: Process, worker: int) -> list[int]:
    """The processes that a worker has been so far, the last one being the one that runs."""
    found = re.findall(rf'worker {worker} \(.*\) is process (\d+)', process.output())
    return [int(pid) for pid in found]


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has waited for yet has ended, too."""
    try:
        return ' (zombie)' in Path(f'/proc/{pid}/status').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return True


def wait_until_gone(*all_of: int) -> None:
    """Wait until none of these processes runs."""
    eventually(lambda: all(map(gone, all_of)), 60, lambda: f'one of {all_of} still runs')
