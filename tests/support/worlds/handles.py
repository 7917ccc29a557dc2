"""A worker as its supervisor sees it, without a process."""

import selectors

from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.plan import Rank, Share
from ros2_kafka_bridge.process.worker_handle import WorkerHandle


def handle(*routes: str, number: int = 1, rank: Rank = Rank.TO_ROS) -> WorkerHandle:
    """A worker of such routes that was not started yet."""
    child = ChildProcess('process.worker', 'snapshots', selectors.DefaultSelector())
    return WorkerHandle(number, Share(routes, rank), child)


def hear(worker: WorkerHandle, said: bytes) -> None:
    """Let it tell some whole lines."""
    worker.on_lines(said.split(b'\n')[:-1])
