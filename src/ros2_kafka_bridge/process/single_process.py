"""A bridge in one process: its routes run here, and a supervisor looks after them in a thread.

A process needs its DDS profile from its start on. So what a reload brings runs in workers of
their own, beside the routes that stay here.
"""

import os
import threading
from typing import TYPE_CHECKING

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.process.in_process_worker import InProcessWorker
from ros2_kafka_bridge.process.plan import Plan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.supervisor import Supervisor
from ros2_kafka_bridge.process.systemd import Systemd

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge, Tell


def run_in_process(
    bridge: 'Bridge', plan: Plan, signals: Signals, log_format: str, tell: 'Tell'
) -> int:
    """Run a bridge until it is told to stop; returns the exit status.

    Args:
        bridge: With all routes.
        plan: What it runs.
        signals: Handled already.
        log_format: How workers write a line of the log.
        tell: Told of what happens.

    Raises:
        BridgeError: It cannot begin.
    """
    systemd = Systemd.from_environ(os.environ)
    own = InProcessWorker(bridge, signals.wakeup, tells_often=systemd.listens)
    words = [f'--log-format={log_format}', '--', plan.file]
    try:
        supervisor = Supervisor(plan, words, systemd, signals, own)
    except OSError as error:
        raise TransportError(f'the bridge cannot begin: {error.strerror}') from error
    statuses: list[int] = []

    def supervise() -> None:
        """Look after the bridge; in a thread of its own."""
        try:
            with supervisor:
                statuses.append(supervisor.run())
        except BaseException:  # noqa: BLE001 (whatever it is)
            # A bridge that hears nothing any more could not even be stopped.
            route_log().critical('a bug of the bridge ends it: draining', exc_info=True)
            statuses.append(1)
            signals.on_stop = bridge.stop.on_signal
            if not bridge.stop.asked:
                bridge.stop.ask()

    beside = threading.Thread(target=supervise, name='supervisor', daemon=True)
    beside.start()
    try:
        statuses.append(own.run(tell))
    finally:
        beside.join()
    return max(statuses)
