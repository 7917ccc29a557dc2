"""The process above the workers of a bridge: starts them, restarts one that dies, drains them.

It holds no ROS, no Kafka client and no route: nothing that could end it together with a worker.
It speaks to each worker by its standard input, and reads its snapshots from a pipe.
"""

import argparse
import os
import selectors
import signal
import sys
import time
from collections.abc import Sequence
from typing import Final

from ros2_kafka_bridge import logs
from ros2_kafka_bridge.metrics import Snapshot
from ros2_kafka_bridge.shares import Share, share_out
from ros2_kafka_bridge.status import status_line
from ros2_kafka_bridge.stop import Stop
from ros2_kafka_bridge.worker import SIGNALS
from ros2_kafka_bridge.worker_process import WorkerProcess

STATUS_S: Final = 10.0
_CLOSING_S: Final = 10.0
_AT_ONCE_S: Final = 5.0
_LOOK_S: Final = 0.1
_CANNOT_START: Final = 2
_PIPE_BYTES: Final = 65536


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the workers until a stop is asked for; returns the exit status."""
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.supervisor')
    parser.add_argument('file')
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--workers', type=int, required=True)
    parser.add_argument('--drain-s', type=float, required=True)
    parser.add_argument('--to-ros', action='append', default=[])
    parser.add_argument('--from-ros', action='append', default=[])
    options = parser.parse_args(arguments)
    logs.set_up(options.log_format)
    shares = share_out(options.to_ros, options.from_ros, options.workers)
    command = [f'--log-format={options.log_format}', '--', options.file]
    supervisor = Supervisor(shares, command, options.drain_s)
    for number in SIGNALS:
        signal.signal(number, lambda *_: supervisor.stop.ask())
    # Whoever started this process may have held them back until now.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    return supervisor.run()


class Supervisor:
    """Runs a worker for each share.

    Args:
        shares: The routes of each worker.
        command: What every worker's arguments end with.
        drain_s: The longest drain of all routes.
    """

    def __init__(self, shares: Sequence[Share], command: Sequence[str], drain_s: float) -> None:
        self.stop = Stop()
        self._workers = [WorkerProcess(number, share) for number, share in enumerate(shares, 1)]
        self._command = command
        self._drain_s = drain_s
        self._log = logs.route_log()
        self._status = 0

    def run(self) -> int:
        """Run until a stop is asked for; returns the exit status."""
        # The workers to ROS hold one end, so that those from ROS see at the other when the last
        # of them has ended, even without a supervisor.
        self._upstream_ended, self._upstream_runs = os.pipe()
        with selectors.DefaultSelector() as self._selector:
            self._watch()
            self._shut_down()
        return self._status

    # Run

    def _watch(self) -> None:
        told_s, before = time.monotonic(), self._snapshots()
        while not self.stop.asked and not all(worker.over for worker in self._workers):
            for worker in self._workers:
                if worker.due:
                    self._start(worker)
            self._look()
            if (period_s := time.monotonic() - told_s) > STATUS_S:
                now = self._snapshots()
                for route, snapshot in now.items():
                    line = status_line(snapshot, before[route], period_s)
                    logs.route_log(route).info('%s', line)
                told_s, before = time.monotonic(), now

    def _snapshots(self) -> dict[str, Snapshot]:
        return {name: s for worker in self._workers for name, s in worker.snapshots.items()}

    def _start(self, worker: WorkerProcess) -> None:
        pipe = self._upstream_runs if worker.to_ros else self._upstream_ended
        order = [] if worker.to_ros else [f'--after={pipe}']
        # Ctrl-C is for the supervisor: held back until the worker ignores it.
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            worker.start([*order, *self._command], pipe)
            self._selector.register(worker.pipe, selectors.EVENT_READ, worker)
            self._log.info('%s is process %d', worker, worker.pid)
        except OSError as error:
            self._fail(worker, f'could not be started ({error.strerror})')
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def _look(self) -> None:
        """Read what the workers say, and see which have ended."""
        for key, _ in self._selector.select(_LOOK_S):
            self._read(key.data)
        for worker in self._workers:
            if (status := worker.exit_status()) is not None:
                while worker.pipe >= 0:
                    self._read(worker)
                self._ended(worker, status)

    def _read(self, worker: WorkerProcess) -> None:
        data = os.read(worker.pipe, _PIPE_BYTES)
        if data:
            worker.hear(data)
        else:
            self._selector.unregister(worker.pipe)
            worker.close_pipe()

    def _ended(self, worker: WorkerProcess, status: int) -> None:
        failed = worker.failed_for_good
        self._status = max(self._status, 1 if failed else 0)
        if self.stop.asked:
            worker.over = True
            self._status = max(self._status, 1 if status else 0)
        elif status == _CANNOT_START and worker.starts == 1:
            worker.over = True
            self._status = _CANNOT_START  # it has said why
            self.stop.ask()
        elif len(failed) == len(worker.snapshots):
            worker.over = True
            self._log.error('%s has ended: its routes have failed for good', worker)
        else:
            self._fail(worker, _how(status))

    def _fail(self, worker: WorkerProcess, how: str) -> None:
        wait_s = worker.fail(how)
        self._log.error('%s %s: started again in %.0f s', worker, how, wait_s)

    # Shutdown

    def _shut_down(self) -> None:
        """Drain the workers to ROS, then those from ROS; what does not end in time is killed."""
        if any(worker.runs for worker in self._workers):
            self._log.info('stopping: draining; once more stops at once')
        if any(worker.away for worker in self._workers):
            self._status = max(self._status, 1)
        deadline_s = time.monotonic() + self._drain_s + _CLOSING_S
        self._drain([worker for worker in self._workers if worker.to_ros], deadline_s)
        self._drain(self._workers, max(deadline_s, time.monotonic() + _AT_ONCE_S))
        for worker in self._workers:
            if worker.runs:
                worker.kill()
                self._status = max(self._status, 1)
                self._log.error('%s did not end in time and was killed', worker)

    def _drain(self, workers: Sequence[WorkerProcess], deadline_s: float) -> None:
        for worker in workers:
            worker.ask(1)
        while any(worker.runs for worker in workers) and time.monotonic() < deadline_s:
            self._look()
            if self.stop.at_once:
                for worker in self._workers:
                    worker.ask(2)
                deadline_s = min(deadline_s, time.monotonic() + _AT_ONCE_S)


def _how(status: int) -> str:
    if status >= 0:
        return f'ended with status {status}'
    try:
        return f'was ended by {signal.Signals(-status).name}'
    except ValueError:
        return f'was ended by signal {-status}'


if __name__ == '__main__':
    sys.exit(main())
