"""The process above the workers of a bridge: starts them, restarts one that dies, drains them.

It holds no ROS, no Kafka client and no route: nothing that could end it together with a worker.
It speaks to each worker by its standard input, and reads its snapshots from a pipe. What the
configuration held when it started is what every worker runs, however late it is started again.
"""

import argparse
import os
import selectors
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge import logs
from ros2_kafka_bridge.metrics import Snapshot
from ros2_kafka_bridge.shares import Share, share_out
from ros2_kafka_bridge.status_log import StatusLog
from ros2_kafka_bridge.stop import SIGNALS, Stop, signals_to_heed
from ros2_kafka_bridge.term import OVERLAP_S
from ros2_kafka_bridge.worker_process import WorkerProcess

_CLOSING_S: Final = 10.0 + OVERLAP_S
_AT_ONCE_S: Final = 5.0
_LOOK_S: Final = 0.1
_FAILED: Final = 1
_CANNOT_START: Final = 2
_PIPE_BYTES: Final = 65536


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the workers until a stop is asked for; returns the exit status."""
    options = _parse(arguments)
    logs.set_up(options.log_format)
    try:
        content = options.file.read_bytes().decode('utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        print(f'{options.file}: cannot be read: {error}', file=sys.stderr)  # noqa: T201 (for the user)
        return _CANNOT_START
    shares = share_out(options.to_ros, options.from_ros, options.workers)
    with (
        _held(content) as held,
        Supervisor(shares, _command(options, held), options.drain_s) as it,
    ):
        for number in signals_to_heed():
            signal.signal(number, it.stop.on_signal)
        # Whoever started this process may have held them back until now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        return it.run()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.supervisor')
    parser.add_argument('file', type=Path)
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--workers', type=int, required=True)
    parser.add_argument('--drain-s', type=float, required=True)
    parser.add_argument('--to-ros', action='append', default=[])
    parser.add_argument('--from-ros', action='append', default=[])
    return parser.parse_args(arguments)


class Command(NamedTuple):
    """What every worker is started with.

    Args:
        arguments: What its arguments end with.
        inherited: The file descriptors that they name.
    """

    arguments: Sequence[str]
    inherited: Sequence[int] = ()


def _command(options: argparse.Namespace, content: int) -> Command:
    words = (f'--log-format={options.log_format}', f'--content={content}')
    return Command([*words, '--', str(options.file)], [content])


@contextmanager
def _held(content: str) -> Iterator[int]:
    """A file in memory that the workers inherit: secrets may stand in it."""
    descriptor = os.memfd_create('configuration')
    try:
        with open(descriptor, 'wb', closefd=False) as file:
            file.write(content.encode())
        yield descriptor
    finally:
        os.close(descriptor)


class Supervisor:
    """Runs a worker for each share, in a `with` of its own.

    Args:
        shares: The routes of each worker.
        command: How each is started.
        drain_s: The longest drain of all routes.
    """

    def __init__(self, shares: Sequence[Share], command: Command, drain_s: float) -> None:
        self.stop = Stop()
        self._workers = [WorkerProcess(number, share) for number, share in enumerate(shares, 1)]
        self._command = command
        self._drain_s = drain_s
        self._log = logs.route_log()
        self._status = 0
        self._selector = selectors.DefaultSelector()
        # The workers to ROS hold one end, so that those from ROS see at the other when the last
        # of them has ended, even without a supervisor.
        self._upstream_ended, self._upstream_runs = os.pipe()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            if worker.pipe >= 0:
                self._close(worker)
        self._selector.close()
        os.close(self._upstream_ended)
        os.close(self._upstream_runs)

    def run(self) -> int:
        """Run until a stop is asked for; returns the exit status."""
        self._watch()
        self._shut_down()
        return self._status

    # Run

    def _watch(self) -> None:
        status = StatusLog(self._snapshots)
        while not self.stop.asked and not all(worker.over for worker in self._workers):
            for worker in self._workers:
                if worker.due:
                    self._start(worker)
            self._look()
            status.say()

    def _snapshots(self) -> list[Snapshot]:
        return [s for worker in self._workers for s in worker.snapshots.values()]

    def _start(self, worker: WorkerProcess) -> None:
        pipe = self._upstream_runs if worker.to_ros else self._upstream_ended
        order = [] if worker.to_ros else [f'--after={pipe}']
        # Ctrl-C is for the supervisor: held back until the worker ignores it.
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            arguments, inherited = self._command
            worker.start([*order, *arguments], [pipe, *inherited])
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
            self._close(worker)

    def _close(self, worker: WorkerProcess) -> None:
        self._selector.unregister(worker.pipe)
        worker.close_pipe()

    def _ended(self, worker: WorkerProcess, status: int) -> None:
        failed = worker.failed_for_good
        # A worker that was killed and comes back has lost nothing; one that gave up says so.
        if failed or status == _FAILED or (status and self.stop.asked):
            self._status = max(self._status, _FAILED)
        if self.stop.asked:
            worker.over = True
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
            self._status = max(self._status, _FAILED)
        deadline_s = time.monotonic() + self._drain_s + _CLOSING_S
        self._drain([worker for worker in self._workers if worker.to_ros], deadline_s)
        self._drain(self._workers, max(deadline_s, time.monotonic() + _AT_ONCE_S))
        for worker in self._workers:
            if worker.runs:
                worker.kill()
                self._status = max(self._status, _FAILED)
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
