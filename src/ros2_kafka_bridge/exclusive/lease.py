"""On what a route runs in a term: with its spool, with the lock, and not failing for long."""

import time
from collections.abc import Callable
from typing import Final

from ros2_kafka_bridge.errors import SpoolInUseError
from ros2_kafka_bridge.exclusive.beside import LOOK_S
from ros2_kafka_bridge.exclusive.handover_window import MOST_S
from ros2_kafka_bridge.exclusive.term import Term
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.running.route_runner import RouteRunner
from ros2_kafka_bridge.running.route_status import Shown
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Pipeline

# For a bridge of this machine that ran the route before to put the spool away, beyond its drain.
_SPOOL_S: Final = 5.0
# Until the route is left to it: who went on just now (SIGCONT) needs one of them.
_SPOOL_WAITS: Final = 2
# A route that fails for so long goes to a bridge that may be able to run it. What it holds in
# memory is given up for that, so it is given away only to a bridge that stands by.
_FAILING_S: Final = 30.0


class Lease:
    """The conditions of a term, asked by the thread that runs the route.

    Args:
        runner: Of the route.
        term: Which it is.
        claim: Keeps the spool; a `SpoolInUseError` while another process has it.
    """

    def __init__(self, runner: RouteRunner, term: Term, claim: Callable[[Pipeline], None]) -> None:
        self._runner = runner
        self._term = term
        self._claim = claim
        self._since_s: float | None = None  # the spool is waited for
        self._in_vain = 0  # how often its time was up while a bridge stood by

    def may_run(self, pipeline: Pipeline, stop: Stop) -> bool:
        """Wait until a bridge of this machine, whose turn is over, has put the spool away.

        The ROS endpoint is open meanwhile: that one reads until it sees it. False at a stop.

        Raises:
            SpoolInUseError: It has had time enough, and may not know that its turn is over.
            RouteError: The spool cannot be used.
        """
        while True:
            try:
                self._claim(pipeline)
            except SpoolInUseError as in_use:
                self._wait_for_spool(in_use)
            else:
                self._since_s, self._in_vain = None, 0
                return True
            if stop.wait(LOOK_S):
                return False

    def _wait_for_spool(self, in_use: SpoolInUseError) -> None:
        text = f'its turn has come, but {in_use.short}'
        self._runner.show(Shown(State.WAITING, text))
        now_s = time.monotonic()
        if self._since_s is None:
            self._since_s = now_s
            self._runner.log.info('%s', text)
        if now_s - self._since_s > MOST_S + self._runner.route.drain_s + _SPOOL_S:
            self._since_s = None
            raise in_use

    def is_ours(self) -> bool:
        """Whether no other bridge goes on with the route: what has failed may be its concern."""
        with self._term.guard:
            self._term.listen()
            return not self._term.is_lost

    def is_kept(self) -> bool:
        """Leave a route that has failed to a bridge that stands by, if this one cannot run it."""
        with self._term.guard:
            if self._term.is_lost:
                return False
            stop = self._runner.stop
            # Kafka takes a while to answer: a stop may come meanwhile, and has a drain.
            if stop.asked or not self._is_for_another() or stop.asked:
                return True
            self._say_given_away()
            self._term.leave()
            return False

    def _is_for_another(self) -> bool:
        """Whether one stands by, and this has tried for long, or twice in vain for the spool."""
        holder = self._spool_holder
        if holder is None and self._failing_s < _FAILING_S:
            return False
        has_standby = self._term.has_standby()
        self._in_vain = self._in_vain + (holder is not None) if has_standby else 0
        return has_standby and (holder is None or self._in_vain >= _SPOOL_WAITS)

    @property
    def _spool_holder(self) -> str | None:
        """Which process has the spool, where it has failed for that."""
        last = self._runner.failures.last
        return None if last is None else last.holder

    @property
    def _failing_s(self) -> float:
        since_s = self._runner.failures.since_s
        return 0.0 if since_s is None else time.monotonic() - since_s

    def _say_given_away(self) -> None:
        pipeline, holder = self._runner.pipeline, self._spool_holder
        held = 0 if pipeline is None else pipeline.snapshot.in_flight
        given_up = f', {count(held, "message")} given up' if held else ''
        why = f'has failed for {self._failing_s:.0f} s'
        if holder is not None:
            why = f'{holder}, so what the reader here holds may be lost'
        self._runner.log.warning('%s: left to a bridge that stands by%s', why, given_up)
