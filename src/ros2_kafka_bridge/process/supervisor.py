"""The process above the workers of a bridge: starts them, restarts one that dies, drains them.

It holds no ROS, no Kafka client and no route: nothing that could end it together with a worker.
It speaks to each worker by its standard input, and reads its snapshots from a pipe. What the
configuration held when it was read is what every worker runs, however late it is started again.

A bridge in one process has it in a thread (`single_process`).
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
from ros2_kafka_bridge.process.control_plane import ControlPlane
from ros2_kafka_bridge.process.draining import drain
from ros2_kafka_bridge.process.in_process_worker import InProcessWorker
from ros2_kafka_bridge.process.monitor_process import MonitorProcess, bind
from ros2_kafka_bridge.process.plan import OFF, Plan, read_plan
from ros2_kafka_bridge.process.reports import in_words, is_live, report_of
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.process.worker_pool import CANNOT_START, WorkerPool
from ros2_kafka_bridge.protocol.limits import STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle
from ros2_kafka_bridge.route.counters import Snapshot
from ros2_kafka_bridge.route.status import StatusLog
from ros2_kafka_bridge.threads.stop import Stop

_LOOK_S: Final = 0.1
_LISTEN_S: Final = 0.25  # where systemd or a terminal is all there is to look at
_SILENT_S: Final = 1.0  # whether workers say nothing, or one that has told its end is gone
_IDLE_S: Final = 10.0  # where only signals are waited for
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
        listener = bind(OFF if monitoring is None else monitoring.listen, plan.file)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201 (for the user)
        return CANNOT_START
    words = [f'--log-format={options.log_format}', '--', str(options.file)]
    signals = Signals(had_terminal=options.terminal)
    with Supervisor(plan, words, systemd, signals) as supervisor:
        if monitoring is not None:
            supervisor.watch(listener, options.log_format)
        signals.install()
        return supervisor.run()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.process.supervisor')
    parser.add_argument('file', type=Path)
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--plan', type=int, required=True, metavar='FD')
    parser.add_argument('--terminal', action='store_true', help='there was one at the start')
    return parser.parse_args(arguments)


class Supervisor:
    """Looks after the workers of a bridge, in a `with` of its own.

    Args:
        plan: What to run.
        arguments: What the arguments of every worker end with.
        systemd: Told how the bridge is doing.
        signals: Ask for a stop and for a reload, from now on.
        own: The bridge in this process, with all routes; None where workers run them.

    Raises:
        OSError: The system has no room for it.
    """

    def __init__(
        self,
        plan: Plan,
        arguments: Sequence[str],
        systemd: Systemd,
        signals: Signals,
        own: InProcessWorker | None = None,
    ) -> None:
        self.stop = Stop(signals.wakeup)
        unconfigured = plan.monitoring is not None and plan.monitoring.start == 'unconfigured'
        first = Lifecycle.UNCONFIGURED if unconfigured else Lifecycle.ACTIVE
        with ExitStack() as undone:
            self._selector = undone.enter_context(selectors.DefaultSelector())
            self._selector.register(signals.wakeup.descriptor, selectors.EVENT_READ)
            self.pool = WorkerPool(plan, arguments, self._selector, self.stop)
            undone.pop_all()
        if own is not None:
            self.pool.add_own(own)
        self.control = ControlPlane(self.pool, first, self.stop)
        self._systemd = systemd
        self._monitor: MonitorProcess | None = None
        self._signals = signals
        self._own = own
        self._log = logs.route_log()
        self._started_s = time.time()
        self._report_at_s = 0.0
        self._told: object = None
        signals.on_stop = self.stop.on_signal

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.control.close()
        if self._monitor is not None:
            self._monitor.close()
        self.pool.close()
        self._selector.close()

    def watch(self, listener: socket.socket | None, log_format: str) -> None:
        """Have a process that watches the bridge.

        Args:
            listener: Where it listens; None for nowhere.
            log_format: How it writes a line of the log.
        """
        on_request = self.control.handle
        self._monitor = MonitorProcess(listener, log_format, self._selector, on_request)
        self.control.on_configured = self._monitor.configure
        self._monitor.configure(self.control.configured())

    def run(self) -> int:
        """Run until a stop is asked for; returns the exit status."""
        status = StatusLog(self._snapshots)
        self.control.step()
        while not self.stop.asked:
            self._tick()
            self.control.step()
            if self._is_over:
                break
            status.say()
            self._wait()
        self._shut_down()
        return self.pool.status

    @property
    def _is_over(self) -> bool:
        """Whether there is nothing left to do: every route has failed for good."""
        active = self.control.lifecycle is Lifecycle.ACTIVE
        return active and not self.control.is_busy and self.pool.is_over

    def _snapshots(self) -> list[Snapshot]:
        """Of the workers: the bridge in this process speaks for itself."""
        workers = [w for w in self.pool.workers if not (w.waits or w.is_in_process)]
        return [s for worker in workers for s in worker.snapshots.values()]

    # A turn

    def _tick(self) -> None:
        """Take what everybody tells, and tell how the bridge is doing."""
        self.pool.tick()
        if self._own is not None and self._own.is_stopping and not self.stop.asked:
            self.stop.ask()
        if self._monitor is not None:
            self._report(self._monitor)
            self._monitor.tick()
        self._signals.check_terminal()
        if self._may_reload and self._signals.take_reload():
            self._systemd.reloading()
            self.control.enqueue_reload()
        self._notify()

    def _wait(self) -> None:
        """Wait until somebody tells something, or a look is due anyway."""
        self._selector.select(self._wait_s)
        self._signals.wakeup.clear()  # what it was rung for is looked at next

    @property
    def _wait_s(self) -> float:
        """How long to wait at most for somebody who tells something."""
        if self.stop.asked or self.control.is_busy:
            return _LOOK_S
        next_s = self.pool.next_look_s
        if self._monitor is not None:
            next_s = min(next_s, self._monitor.next_look_s, self._report_at_s)
        longest_s = _IDLE_S if all(w.is_in_process for w in self.pool.workers) else _SILENT_S
        if self._systemd.listens or self._signals.had_terminal:
            longest_s = _LISTEN_S
        return min(longest_s, max(0.0, next_s - time.monotonic()))

    @property
    def _may_reload(self) -> bool:
        """Whether the bridge in this process, if it is there, has begun: before, it cannot end."""
        return self._own is None or self._own.has_begun

    def _report(self, monitor: MonitorProcess) -> None:
        """Report each second, and at once where something has changed."""
        control, now_s = self.control, time.monotonic()
        told = (
            (control.lifecycle, control.last_reload, self.pool.plan.file, self.stop.asked),
            [(w.number, w.process.pid, w.has_begun, len(w.snapshots)) for w in self.pool.workers],
            set(self.pool.paused),
        )
        if told != self._told or now_s >= self._report_at_s:
            self._told, self._report_at_s = told, now_s + _REPORT_S
            stopping = self.stop.asked
            monitor.report(report_of(self.pool, control, self._started_s, stopping=stopping))

    def _notify(self) -> None:
        self._systemd.tick()
        if not self._systemd.listens:
            return
        snapshots = self.pool.snapshots()
        silent_s = max((worker.silent_s for worker in self.pool.workers), default=0.0)
        if is_live(snapshots) and silent_s < STUCK_S:
            self._systemd.alive()
        if self.stop.asked or self.control.is_busy:
            return
        text = in_words(self.control.lifecycle, snapshots)
        if self.pool.has_begun:
            self._systemd.ready(text)
            self._systemd.status(text)

    # Shutdown

    def _shut_down(self) -> None:
        """Drain the workers to ROS, then those from ROS; what does not end in time is killed."""
        self.control.close()
        self._systemd.stopping()
        says_it_itself = self._own is not None and self._own.is_running
        if not says_it_itself and any(worker.process.is_running for worker in self.pool.workers):
            self._log.info('stopping: draining; once more stops at once')
        for _ in drain(self.pool, lambda: self.stop.at_once):
            self._wait()
            self._tick()
        self.control.lifecycle = Lifecycle.FINALIZED
        if self._monitor is not None:
            self._report(self._monitor)


if __name__ == '__main__':
    sys.exit(main())
