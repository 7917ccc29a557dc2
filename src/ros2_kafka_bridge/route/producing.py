"""What the producer of a route has got, and what it gets again."""

import time
from collections.abc import Callable, Sequence
from typing import Final

from ros2_kafka_bridge.endpoints import RecordSink, Reports
from ros2_kafka_bridge.errors import (
    BridgeError,
    RecordError,
    RecordTooLargeError,
    TransportError,
)
from ros2_kafka_bridge.route.flight.messages import MessageEntry, MessageFlight

# A wake-up costs as much as ten messages, a request as much as a hundred. Where messages come
# often, a short rest lets the next ones gather; where they come seldom, none waits for another.
_OFTEN_PER_S: Final = 2000.0
_SMALL_BATCH: Final = 50
_GATHER_S: Final = 0.001


class Producing:
    """Hands the entries that wait to the producer, in their order.

    A broker that finds one record too large refuses all that came with it: those go again, each
    in a request of its own.

    Args:
        flight: Where the entries are.
        sink: The producer; open while a route runs.
        refuse: Told of an entry that can never be delivered, which waits no more.
    """

    def __init__(
        self,
        flight: MessageFlight,
        sink: RecordSink[MessageEntry],
        refuse: Callable[[MessageEntry, RecordError], None],
    ) -> None:
        self._flight = flight
        self._sink = sink
        self._refuse = refuse
        self._sent = 0  # how many the producer has got
        self._alone: MessageEntry | None = None  # what it has got by itself
        self._taken_at_s = 0.0

    @property
    def is_idle(self) -> bool:
        """Whether the producer has nothing of the route."""
        return not self._sent

    def begin(self) -> None:
        """Note that the producer is a new one."""
        self._sent = 0
        self._alone = None

    def produce_ready(self) -> None:
        """Produce what waits, as far as there is room."""
        lane = self._flight.lane
        while lane.ready and self._alone is None:
            error = self._produce()
            if error is None:
                return
            self._refuse(self._flight.hold_first(lane), error)

    def _produce(self) -> RecordTooLargeError | None:
        """Produce from the first on; tells why the next one can never be."""
        produce, sent = self._sink.produce, self._sent
        now_s, produced = time.monotonic(), 0
        try:
            for entry in self._flight.lane.ready:
                alone = entry.goes_alone
                if (alone and (sent or produced)) or not produce(entry.record, entry):
                    return None
                entry.produced_s = now_s
                produced += 1
                if alone:
                    self._alone = entry
                    return None
        except RecordTooLargeError as error:
            return error
        finally:
            self._sent += len(self._flight.sent(self._flight.lane, produced))
        return None

    def send(self, taken: int) -> None:
        """Send a batch that was taken and produced, or rest for the next one."""
        now_s = time.monotonic()
        if 0 < taken < _SMALL_BATCH:
            if taken > _OFTEN_PER_S * (now_s - self._taken_at_s):
                time.sleep(_GATHER_S)
            else:
                self._sink.hurry()
        self._taken_at_s = now_s

    def poll(self, timeout_s: float) -> Reports[MessageEntry]:
        """Wait up to `timeout_s` for reports; who has read them lets the failed ones go again."""
        reports = self._sink.poll(timeout_s)
        self._sent -= len(reports.confirmed) + len(reports.failed)
        return reports

    def produce_again(self, failed: Sequence[tuple[MessageEntry, BridgeError]]) -> None:
        """Let wait again what has failed for now, in the order of taking.

        Raises:
            RouteError: One has failed for a reason that somebody has to mend.
        """
        alone = self._alone
        if not self._sent:
            self._alone = None
        again = []
        for entry, error in failed:
            if isinstance(error, RecordTooLargeError) and entry is not alone:
                entry.goes_alone = True
                again.append(entry)
            elif isinstance(error, RecordError):
                self._refuse(entry, error)
            elif isinstance(error, TransportError):
                again.append(entry)
            else:
                raise error
        self._flight.requeue(again)
