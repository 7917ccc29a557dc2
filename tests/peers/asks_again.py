"""Asks the nodes at a topic for its type, again and again, and prints how that has grown.

Usage: asks_again.py TIMES TOPIC TYPE; prints `grew N kB, N files`, from half of the times on.
"""

import os
import sys
from pathlib import Path

from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.used_type import asks_users, wait_for_type
from ros2_kafka_bridge.threads.stop import Stop


def main(times: int, topic: str, name: str) -> None:
    """Ask, and look at this process."""
    seen: list[tuple[int, int]] = []
    with open_node('asks_again', None, Histories({}, {}, None)) as node:
        used = wait_for_type(lambda: node.publishers(topic), topic, Stop().wait)
        assert used is not None
        [wanted] = used.definitions
        ask = asks_users(node, topic)
        for _ in range(2):
            for _ in range(times // 2):
                assert name in ask(name, wanted).types
            seen.append((resident_kb(), len(os.listdir('/proc/self/fd'))))  # noqa: PTH208
    (kb, files), (kb_now, files_now) = seen
    print(f'grew {kb_now - kb} kB, {files_now - files} files', flush=True)  # noqa: T201


def resident_kb() -> int:
    """How much memory this process has now."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') // 1024


main(int(sys.argv[1]), sys.argv[2], sys.argv[3])
