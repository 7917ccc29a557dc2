"""A bridge in one process: it hears its signals, speaks to systemd, and reloads.

A process needs its DDS profile from its start on. So what a reload brings runs in workers of
their own, beside the routes that stay here: from then on this process is their supervisor, too,
in a thread.
"""

import os
import threading
from typing import TYPE_CHECKING, Final

from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.process.hangup import Signals
from ros2_kafka_bridge.process.plan import Plan
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.protocol.worker import Begun, Event

if TYPE_CHECKING:
    from ros2_kafka_bridge.bridge import Bridge, Tell
    from ros2_kafka_bridge.process.supervisor import Supervisor
    from ros2_kafka_bridge.threads.stop import Stop

_LOOK_S: Final = 0.25
_IDLE_S: Final = 10.0  # where only signals are heard


class Standalone:
    """Runs a bridge until it is told to stop.

    Args:
        bridge: With all routes.
        plan: What it runs.
        signals: Heard already.
        log_format: How workers write a line of the log.
    """

    def __init__(self, bridge: 'Bridge', plan: Plan, signals: Signals, log_format: str) -> None:
        self._bridge = bridge
        self._plan = plan
        self._signals = signals
        self._log_format = log_format
        self._systemd = Systemd.from_environ(os.environ)
        self._stop: Stop = bridge.stop
        self._begun = self._ended = False
        self._status: int | None = None  # of the bridge in this process
        self._others = 0  # of the workers

    def run(self, tell: 'Tell') -> int:
        """Run to the end; returns the exit status."""

        def told(event: Event) -> None:
            self._begun = self._begun or isinstance(event, Begun)
            self._signals.wakeup.ring()
            tell(event)

        self._signals.on_stop = self._on_stop
        beside = threading.Thread(target=self._keep_looking, name='signals', daemon=True)
        beside.start()
        status = 1
        try:
            self._status = status = self._bridge.run(told)
        finally:
            self._ended = True
            self._signals.wakeup.ring()
            beside.join()
        return max(status, self._others)

    def _on_stop(self, number: int) -> None:
        self._stop.on_signal(number)  # that of the bridge, or of the supervisor that came later

    # Beside the bridge

    def _keep_looking(self) -> None:
        """Look after the bridge; in a thread of its own."""
        try:
            self._look_after()
        except BaseException:
            # A bridge that hears nothing any more could not even be stopped.
            log = route_log()
            log.critical('a bug of the bridge ends it: draining', exc_info=True)
            self._others = 1
            self._stop = self._bridge.stop
            if not self._stop.asked:
                self._stop.ask()

    def _look_after(self) -> None:
        """Hear what signals ask for."""
        while not self._ended:
            self._signals.look()
            if self._wants_reload() and (supervisor := self._supervisor()) is not None:
                self._supervise(supervisor)
                return
            if self._systemd.listens:
                self._notify()
            looks = self._systemd.listens or self._signals.had_terminal
            self._signals.wakeup.wait(_LOOK_S if looks else _IDLE_S)
            self._signals.wakeup.clear()

    def _notify(self) -> None:
        """Tell systemd how the bridge is doing."""
        from ros2_kafka_bridge.process.reports import in_words, is_live  # noqa: PLC0415 (not for its supervisor)
        from ros2_kafka_bridge.protocol.monitor import Lifecycle  # noqa: PLC0415 (the same)

        snapshots = self._bridge.snapshots()
        self._systemd.tick()
        if is_live(snapshots):
            self._systemd.alive()
        if self._stop.asked:
            self._systemd.stopping()
        elif self._begun:
            text = in_words(Lifecycle.ACTIVE, snapshots)
            self._systemd.ready(text)
            self._systemd.status(text)

    def _wants_reload(self) -> bool:
        return self._begun and not self._stop.asked and self._signals.take_reload()

    def _supervisor(self) -> 'Supervisor | None':
        """What is to reload; None where the system has no room for it."""
        words = [f'--log-format={self._log_format}', '--', self._plan.file]
        try:
            from ros2_kafka_bridge.process.supervisor import Supervisor  # noqa: PLC0415 (at a reload only)

            return Supervisor(self._plan, words, self._systemd)
        except OSError as error:
            self._systemd.reloading()
            route_log().error('reload: %s: refused: all goes on as it was', error.strerror)
            return None

    def _supervise(self, supervisor: 'Supervisor') -> None:
        """Reload, and look after the workers that this brings, until all has ended."""
        from ros2_kafka_bridge.process.local_worker import LocalWorker  # noqa: PLC0415 (at a reload only)

        with supervisor:
            local = LocalWorker(self._bridge, self._bridge_ended, supervisor.stop)
            supervisor.join(local, self._signals)
            self._stop = supervisor.stop
            if self._bridge.stop.asked:  # in between
                supervisor.stop.ask()
            self._others = supervisor.run()

    def _bridge_ended(self) -> int | None:
        """The status of the bridge in this process; None while it runs."""
        if not self._ended:
            return None
        return 1 if self._status is None else self._status
