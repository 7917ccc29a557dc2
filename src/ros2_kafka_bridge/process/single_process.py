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


class SingleProcess:
    """Runs a bridge until it is told to stop.

    Args:
        bridge: With all routes.
        plan: What it runs.
        signals: Handled already.
        log_format: How workers write a line of the log.
    """

    def __init__(self, bridge: 'Bridge', plan: Plan, signals: Signals, log_format: str) -> None:
        self._bridge = bridge
        self._plan = plan
        self._signals = signals
        self._log_format = log_format
        self._status = 0  # of what looks after it

    def run(self, tell: 'Tell') -> int:
        """Run to the end; returns the exit status.

        Args:
            tell: Told of what happens.

        Raises:
            BridgeError: It cannot begin.
        """
        systemd = Systemd.from_environ(os.environ)
        own = InProcessWorker(self._bridge, self._signals.wakeup, tells_often=systemd.listens)
        words = [f'--log-format={self._log_format}', '--', self._plan.file]
        try:
            supervisor = Supervisor(self._plan, words, systemd, self._signals, own)
        except OSError as error:
            raise TransportError(f'the bridge cannot begin: {error.strerror}') from error
        beside = threading.Thread(
            target=self._supervise, args=(supervisor,), name='supervisor', daemon=True
        )
        beside.start()
        try:
            status = own.run(tell)
        finally:
            beside.join()
        return max(status, self._status)

    def _supervise(self, supervisor: Supervisor) -> None:
        """Look after the bridge; in a thread of its own."""
        try:
            with supervisor:
                self._status = supervisor.run()
        except BaseException:  # noqa: BLE001 (whatever it is)
            # A bridge that hears nothing any more could not even be stopped.
            route_log().critical('a bug of the bridge ends it: draining', exc_info=True)
            self._status = 1
            self._signals.on_stop = self._bridge.stop.on_signal
            if not self._bridge.stop.asked:
                self._bridge.stop.ask()
