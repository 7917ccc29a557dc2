"""A bridge that a test pauses and resumes, and whose snapshots it reads.

    python driven_bridge.py FILE ORDERS [PAUSED ...]

Each line of the file ORDERS is an order: `pause NAME` or `resume NAME`. Snapshots are printed
often, a line of JSON each time, the last ones after the drain.
"""

import logging
import os
import signal
import sys
import threading
import time
from pathlib import Path

from ros2_kafka_bridge.bridge import Bridge
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.load import load_checked
from ros2_kafka_bridge.route.counters import to_line

_PERIOD_S = 0.1


def _say(bridge: Bridge) -> None:
    os.write(1, to_line(bridge.snapshots()))


def _watch(bridge: Bridge, orders: Path) -> None:
    done = 0
    while True:
        lines = orders.read_text().split('\n')[:-1] if orders.exists() else []
        for line in lines[done:]:
            do, route = line.split()
            known = bridge.pause(route) if do == 'pause' else bridge.resume(route)
            logging.getLogger('ros2_kafka_bridge').info('%s: %s', line, known)
        done = len(lines)
        _say(bridge)
        time.sleep(_PERIOD_S)


def main() -> int:
    """Run the bridge until SIGTERM; returns the exit status."""
    file, orders, *paused = sys.argv[1:]
    logs.set_up('text')
    bridge = Bridge(load_checked(Path(file)), paused=frozenset(paused))
    signal.signal(signal.SIGTERM, bridge.stop.on_signal)
    threading.Thread(target=_watch, args=(bridge, Path(orders)), daemon=True).start()
    status = bridge.run()
    _say(bridge)
    return status


sys.exit(main())
