"""The way to the dead letters: records that can never be delivered, kept with the reason."""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Generic

from ros2_kafka_bridge.dead_letters.writer import smaller
from ros2_kafka_bridge.endpoints import RecordSink
from ros2_kafka_bridge.errors import BridgeError, RecordTooLargeError, TransportError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.route.counters import Outcome
from ros2_kafka_bridge.route.flight.flight import E, Flight
from ros2_kafka_bridge.route.flight.stage import SENT
from ros2_kafka_bridge.threads.backoff import Backoff


class DeadLetters(Generic[E]):
    """The sink behind the lane of the dead letters; opened when the first one is written.

    A topic that cannot be written is tried again with backoff, and `problem` says why: the
    pipeline stops reading meanwhile, and nothing is lost or repeated for it.

    Args:
        topic: The dead-letter topic.
        sink: Where its records are produced, not open yet.
        ensure_topic: Creates the topic if it may be.
        log: Where to say what happens.
    """

    def __init__(
        self,
        topic: str,
        sink: RecordSink[E],
        ensure_topic: Callable[[], None],
        log: Log,
    ) -> None:
        self.topic = topic
        self.problem = ''
        self._sink = sink
        self._ensure_topic = ensure_topic
        self._log = log
        self._open = False
        self._sent = 0  # how many the producer has got
        self._again_at_s = 0.0
        self._backoff = Backoff()
        self._error: BridgeError | None = None  # that nobody was told of

    def take_error(self) -> BridgeError | None:
        """Return why the topic could not be written, once for each time."""
        error, self._error = self._error, None
        return error

    def step(self, flight: Flight[E]) -> None:
        """Write the letters of a flight that wait, and end those that were confirmed."""
        if (flight.letters.ready or self._sent) and time.monotonic() >= self._again_at_s:
            try:
                self._deliver(flight)
            except BridgeError as error:
                self._fail(flight, error)
        elif self._open:  # a client that nobody polls keeps all it has to tell
            with suppress(BridgeError):
                self._sink.poll(0.0)

    def close(self, flight: Flight[E]) -> None:
        """Give up what is not written; end what was confirmed meanwhile."""
        self._close_sink(flight)
        self.problem = ''

    def _deliver(self, flight: Flight[E]) -> None:
        if not self._open:
            self._sink.open()
            self._open = True
            self._ensure_topic()
        while flight.letters.ready and self._send(flight):
            pass
        confirmed, failed = self._sink.poll(0.0)
        self._sent -= len(confirmed) + len(failed)
        flight.confirm(confirmed, Outcome.DEAD_LETTERED)
        if confirmed:
            self.problem = ''
            self._backoff = Backoff()
        problems = [self._send_again(flight, *of) for of in failed if of[0].stage is SENT]
        for problem in filter(None, problems):
            raise problem

    def _send(self, flight: Flight[E]) -> bool:
        """Send the first that waits; False where there is no room for it."""
        entry = flight.letters.ready[0]
        try:
            if not self._sink.produce(entry.record._replace(topic=self.topic), entry):
                return False
        except RecordTooLargeError as error:
            flight.hold_first(flight.letters)
            if problem := self._send_again(flight, entry, error):
                raise problem from error
        else:
            flight.sent(flight.letters, 1)
            self._sent += 1
        return True

    def _send_again(self, flight: Flight[E], entry: E, error: BridgeError) -> BridgeError | None:
        """Put a letter back in line, smaller where that helps; return what only a person mends."""
        less = smaller(entry.record) if isinstance(error, RecordTooLargeError) else None
        if less is not None:
            flight.divert(entry, less)
        flight.ready([entry])
        return None if less is not None or isinstance(error, TransportError) else error

    def _fail(self, flight: Flight[E], error: BridgeError) -> None:
        self.problem = f'the dead-letter topic {self.topic} cannot be written: {error}'
        self._error = error
        self._backoff = self._backoff.after()
        self._again_at_s = time.monotonic() + self._backoff.wait_s
        self._log.error('failed: %s; tried again in %.0f s', self.problem, self._backoff.wait_s)
        self._close_sink(flight)
        letters = (entry for entry in flight if entry.lane is flight.letters)
        flight.requeue([letter for letter in letters if letter.stage is SENT])

    def _close_sink(self, flight: Flight[E]) -> None:
        if self._open:
            self._open = False
            self._sent = 0
            flight.confirm(self._sink.close(), Outcome.DEAD_LETTERED)
