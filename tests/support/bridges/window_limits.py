"""How much a route from ROS holds while its Kafka is away, until its publisher is held back."""

import re

from support.processes.harness import Process, eventually

WINDOW = 2000
READER_CACHE = 2000
HISTORY = 5000  # of a publisher whose profile says nothing of it


def first_held_back(bridge: Process) -> int:
    """The number of the message that finds no room, once the window is full.

    It counts from what Kafka has acknowledged: a broker that was killed may hold more than that.
    """
    full = re.compile(rf'waiting \(Kafka is away.*\): (\d+) confirmed.* {WINDOW} in flight')
    eventually(lambda: bool(full.search(bridge.output())), 60, bridge.output)
    [confirmed] = set(full.findall(bridge.output()))
    return int(confirmed) + WINDOW + READER_CACHE + HISTORY
