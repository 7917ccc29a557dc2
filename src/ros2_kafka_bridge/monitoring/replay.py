"""The replay that runs, if one does, and how the last one ended."""

import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.monitoring.replay_process import ReplayOrder

_LINES: Final = 500
_ENDING_S: Final = 5.0


class ReplayRunner:
    """One process at a time that replays dead letters.

    Args:
        done: Called when it has ended: the dead letters have changed.
    """

    def __init__(self, done: Callable[[], None]) -> None:
        self._done = done
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._state: dict[str, Any] = {}
        self._number = 0
        self._log = route_log()

    def state(self) -> dict[str, Any] | None:
        """What the page shows of it; None before the first."""
        with self._lock:
            return {**self._state, 'lines': list(self._lines)} if self._state else None

    def start(self, order: ReplayOrder) -> bool:
        """Begin; False where another one runs.

        Raises:
            OSError: There is no room for a process.
        """
        form = order.form
        with self._lock:
            if self._process is not None:
                return False
            self._process = subprocess.Popen(
                [sys.executable, '-P', '-m', 'ros2_kafka_bridge.monitoring.replay_process'],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            self._number += 1
            self._lines.clear()
            self._state = {
                'number': self._number,
                'topic': form.topic,
                'letters': None if form.places is None else len(form.places),
                'to_ros': form.to_ros,
                'dry_run': form.dry_run,
                'began_s': round(time.time()),
                'status': None,
            }
            process = self._process
        if not form.dry_run:
            which = 'all letters' if form.places is None else f'{len(form.places)} letters'
            self._log.info('replaying %s of %s, as the page was asked to', which, form.topic)
        threading.Thread(
            target=self._follow, args=(process, order), name='replay', daemon=True
        ).start()
        return True

    def stop(self) -> bool:
        """Ask for its end after the batch in hand; False where none runs."""
        with self._lock:
            if self._process is None:
                return False
            self._process.terminate()
            return True

    def close(self) -> None:
        """End one that runs; its transactions leave nothing half done."""
        with self._lock:
            process = self._process
        if process is not None:
            process.terminate()
            try:
                process.wait(_ENDING_S)
            except subprocess.TimeoutExpired:
                process.kill()

    def _follow(self, process: subprocess.Popen[bytes], order: ReplayOrder) -> None:
        assert process.stdin is not None, 'it was started with pipes'
        assert process.stdout is not None, 'it was started with pipes'
        try:
            process.stdin.write(msgspec.json.encode(order) + b'\n')
            process.stdin.flush()  # it stays open: its end tells the process that this one died
        except BrokenPipeError:
            pass  # it says why
        for line in process.stdout:
            text = printable(line.decode(errors='replace').rstrip('\n'))
            with self._lock:
                self._lines.append(text)
        process.stdout.close()
        with suppress(BrokenPipeError):  # what it has not read
            process.stdin.close()
        status = process.wait()
        with self._lock:
            self._state['status'] = status
            self._process = None
            last = self._lines[-1] if self._lines else ''
        if not order.form.dry_run:
            self._log.info('the replay of %s has ended (%d): %s', order.form.topic, status, last)
        self._done()
