"""What the producer of a route has got, and what it gets again."""

import time
from collections.abc import Callable, Sequence

from ros2_kafka_bridge.endpoints import RecordSink, Reports
from ros2_kafka_bridge.errors import (
    BridgeError,
    RecordError,
    RecordTooLargeError,
    TransportError,
)
from ros2_kafka_bridge.route.message_window import MessageEntry, MessageWindow
from ros2_kafka_bridge.route.place import SENT


class Producing:
    """Hands the entries that wait to the producer, in their order.

    A broker that finds one record too large refuses all that came with it: those go again, each
    in a request of its own.

    Args:
        window: Where the entries wait.
        sink: The producer; open while a route runs.
        refuse: Told of an entry that can never be delivered, which waits no more.
    """

    def __init__(
        self,
        window: MessageWindow,
        sink: RecordSink[MessageEntry],
        refuse: Callable[[MessageEntry, RecordError], None],
    ) -> None:
        self._window = window
        self._sink = sink
        self._refuse = refuse
        self._sent = 0  # how many the producer has got
        self._alone: MessageEntry | None = None  # what it has got by itself
        self._alone_up_to = 0  # the last number of those that go alone

    @property
    def is_idle(self) -> bool:
        """Whether the producer has nothing of the route."""
        return not self._sent

    def begin(self) -> None:
        """Note that the producer is a new one: what the one before had got has to wait again."""
        self._sent = 0
        self._alone = None

    def produce_pending(self) -> None:
        """Produce what waits, as far as there is room."""
        pending, produce = self._window.pending, self._sink.produce
        if self._alone is not None or not pending:
            return
        now_s, sent, alone_up_to = time.monotonic(), SENT, self._alone_up_to
        while pending:
            entry = pending[0]
            alone = entry.number <= alone_up_to
            if alone and self._sent:
                return
            try:
                if not produce(entry.record, entry):
                    return
                pending.popleft()
                entry.place = sent
                entry.produced_s = now_s
                self._sent += 1
            except RecordTooLargeError as error:
                pending.popleft()
                self._refuse(entry, error)
                continue
            if alone:
                self._alone = entry
                return

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
                self._alone_up_to = max(self._alone_up_to, entry.number)
                again.append(entry)
            elif isinstance(error, RecordError):
                self._refuse(entry, error)
            elif isinstance(error, TransportError):
                again.append(entry)
            else:
                raise error
        again.sort(key=lambda entry: entry.number)
        self._window.wait_again(again)
