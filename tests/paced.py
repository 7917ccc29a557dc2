"""Numbers that are produced at a rate, from a thread: something can break in their midst."""

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Self

from harness import Bench


def paced(values: Iterable[bytes], rate: float) -> Iterator[bytes]:
    """Yield values, each when it is its turn."""
    start_s = time.monotonic()
    for number, value in enumerate(values):
        time.sleep(max(0.0, start_s + number / rate - time.monotonic()))
        yield value


class Stream:
    """Produces values into a partition at a rate, through an outage of the broker too.

    Args:
        rate: Records a second.
    """

    def __init__(self, bench: Bench, topic: str, values: Iterable[bytes], rate: float) -> None:
        self._bench = bench
        self._topic = topic
        self._values = values
        self._rate = rate
        self._goes_on = threading.Event()
        self._goes_on.set()
        self._thread = threading.Thread(target=self._produce)
        self.sent = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(60)
        assert not self._thread.is_alive()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Produce nothing, with nothing on its way.

        A librdkafka that asks a broker for metadata while that goes down may forget all brokers
        for good: the bridge's clients are replaced then, this one would not be.
        """
        self._goes_on.clear()
        sent = -1
        while sent != self.sent or sent > self._bench.end_offset(self._topic):
            sent = self.sent
            time.sleep(0.1)
        try:
            yield
        finally:
            self._goes_on.set()

    def _produce(self) -> None:
        self._bench.produce(self._topic, self._counted(), partition=0)

    def _counted(self) -> Iterator[bytes]:
        for value in paced(self._values, self._rate):
            self._goes_on.wait()
            yield value
            self.sent += 1
