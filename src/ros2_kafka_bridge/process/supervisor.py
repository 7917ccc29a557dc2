"""The process above the workers of a bridge: starts them, restarts one that dies, drains them.

It holds no ROS, no Kafka client and no route: nothing that could end it together with a worker.
It speaks to each worker by its standard input, and reads its snapshots from a pipe. What the
configuration held when it was read is what every worker runs, however late it is started again.
"""

import argparse
import os
import selectors
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, Self

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.crew import CANNOT_START, Crew
from ros2_kafka_bridge.process.hangup import Signals
from ros2_kafka_bridge.process.local_worker import LocalWorker
from ros2_kafka_bridge.process.monitor_process import MonitorProcess, bind
from ros2_kafka_bridge.process.operations import Operations
from ros2_kafka_bridge.process.plan import OFF, Plan, read_plan
from ros2_kafka_bridge.process.reports import in_words, is_live, report_of
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.protocol.limits import STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.route.status import StatusLog
from ros2_kafka_bridge.threads.stop import Stop

_LOOK_S: Final = 0.1
_REPORT_S: Final = 1.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the workers until a stop is asked for; returns the exit status."""
    options = _parse(arguments)
    logs.set_up(options.log_format)
    systemd = Systemd.from_environ(os.environ)
    plan = read_plan(options.plan)
    os.close(options.plan)
    monitoring = plan.monitoring
    try:
        end = bind(OFF if monitoring is None else monitoring.listen, plan.file)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201 (for the user)
        return CANNOT_START
    words = [f'--log-format={options.log_format}', '--', str(options.file)]
    with Supervisor(plan, words, systemd) as it:
        if monitoring is not None:
            it.watch(end, options.log_format)
        it.handle(Signals(it.stop.on_signal, had_terminal=options.terminal))
        return it.run()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.process.supervisor')
    parser.add_argument('file', type=Path)
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--plan', type=int, required=True, metavar='FD')
    parser.add_argument('--terminal', action='store_true', help='there was one at the start')
    return parser.parse_args(arguments)


class Supervisor:
    """Runs a bridge in several processes, in a `with` of its own.

    Args:
        plan: What to run.
        arguments: What the arguments of every worker end with.
        systemd: Told how the bridge is doing.

    Raises:
        OSError: The system has no room for it.
    """

    def __init__(self, plan: Plan, arguments: Sequence[str], systemd: Systemd) -> None:
        self.stop = Stop()
        unconfigured = plan.monitoring is not None and plan.monitoring.start == 'unconfigured'
        first = Lifecycle.UNCONFIGURED if unconfigured else Lifecycle.ACTIVE
        with ExitStack() as undone:
            self._selector = undone.enter_context(selectors.DefaultSelector())
            self.crew = Crew(arguments, self._selector, self.stop)
            undone.callback(self.crew.close)
            self.operations = Operations(plan, self.crew, first, self.stop)
            undone.pop_all()
        self._systemd = systemd
        self._monitor: MonitorProcess | None = None
        self._signals: Signals | None = None
        self._local: LocalWorker | None = None
        self._log = logs.route_log()
        self._started_s = time.time()
        self._report_at_s = 0.0
        self._told: object = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.operations.close()
        if self._monitor is not None:
            self._monitor.close()
        self.crew.close()
        self.operations.release()
        self._selector.close()

    def watch(self, end: socket.socket | None, log_format: str) -> None:
        """Have a process that watches the bridge.

        Args:
            end: Where it listens; None for nowhere.
            log_format: How it writes a line of the log.
        """
        requests = self.operations.request
        self._monitor = MonitorProcess(end, log_format, self._selector, requests)
        self.operations.on_configured = self._monitor.configure
        self._monitor.configure(self.operations.configured())

    def handle(self, signals: Signals) -> None:
        """Do what signals ask for, from now on."""
        self._signals = signals
        signals.hear()

    def join(self, local: LocalWorker, signals: Signals) -> None:
        """Look after the bridge in this process, too, and begin with a reload.

        Args:
            local: That bridge, with all routes.
            signals: Heard already.
        """
        self._local = local
        self._signals = signals
        self.crew.workers.append(local)
        self.crew.paused |= local.paused
        self._reload()

    def run(self) -> int:
        """Run until a stop is asked for; returns the exit status."""
        if self._local is None and self.operations.lifecycle is Lifecycle.ACTIVE:
            self.operations.start()
        status = StatusLog(self._snapshots)
        while not self.stop.asked and not self._is_over:
            self._turn()
            self.operations.step()
            status.say()
        self._shut_down()
        return self.crew.status

    @property
    def _is_over(self) -> bool:
        """Whether there is nothing left to do: every route has failed for good."""
        active = self.operations.lifecycle is Lifecycle.ACTIVE
        return active and not self.operations.busy and self.crew.over

    def _snapshots(self) -> list[Snapshot]:
        """Of the workers: the bridge in this process speaks for itself."""
        workers = [w for w in self.crew.workers if w is not self._local and not w.waits]
        return [s for worker in workers for s in worker.snapshots.values()]

    # A turn

    def _turn(self) -> None:
        """Listen to everybody for a moment, and tell how the bridge is doing."""
        self.crew.tick()
        if self._monitor is not None:
            self._report()
            self._monitor.tick()
        for key, _ in self._selector.select(_LOOK_S):
            key.data()
        if self._signals is not None:
            self._signals.look()
            if self._signals.take_reload():
                self._reload()
        self._notify()

    def _reload(self) -> None:
        self._systemd.reloading()
        self.operations.reload_once()

    def _report(self) -> None:
        """Report each second, and at once where something has changed."""
        it, now_s = self.operations, time.monotonic()
        workers = tuple((w.number, w.pid, w.begun, len(w.snapshots)) for w in self.crew.workers)
        paused = frozenset(self.crew.paused)
        told = (it.lifecycle, it.reload, it.plan.file, workers, paused, self.stop.asked)
        if self._monitor is not None and (told != self._told or now_s >= self._report_at_s):
            self._told, self._report_at_s = told, now_s + _REPORT_S
            self._monitor.report(
                report_of(
                    it.plan, self.crew, it.lifecycle, self._started_s, it.reload,
                    stopping=self.stop.asked,
                )
            )  # fmt: skip

    def _notify(self) -> None:
        self._systemd.tick()
        snapshots = self.crew.snapshots()
        silent_s = max((worker.silent_s for worker in self.crew.workers), default=0.0)
        if is_live(snapshots) and silent_s < STUCK_S:
            self._systemd.alive()
        if self.stop.asked or self.operations.busy:
            return
        text = in_words(self.operations.lifecycle, snapshots)
        if self.crew.begun:
            self._systemd.ready(text)
            self._systemd.status(text)

    # Shutdown

    def _shut_down(self) -> None:
        """Drain the workers to ROS, then those from ROS; what does not end in time is killed."""
        self.operations.close()
        self._systemd.stopping()
        says_it_itself = self._local is not None and self._local.moves
        if not says_it_itself and any(worker.runs for worker in self.crew.workers):
            self._log.info('stopping: draining; once more stops at once')
        routes = self.operations.plan.routes
        for _ in self.crew.drain(routes, lambda: self.stop.at_once):
            self._turn()
        self.operations.lifecycle = Lifecycle.FINALIZED
        self._report()


if __name__ == '__main__':
    sys.exit(main())
