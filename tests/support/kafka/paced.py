"""Values that are produced at a rate, from a thread: something can break in their midst."""

import itertools
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Self

from support.patience import patient
from support.processes.harness import Bench, eventually

_END_S = 60.0


class Stream:
    """Produces values into a partition at a rate, through an outage of the broker too.

    One that goes on until `end` shows that what happened before was in mid-stream.

    Args:
        values: What is produced; may be without an end.
        rate: Records a second.
    """

    def __init__(
        self, bench: Bench, topic: str, values: Iterable[bytes], rate: float, partition: int = 0
    ) -> None:
        self._bench = bench
        self._topic = topic
        self._values = values
        self._rate = rate
        self._partition = partition
        self._turn = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._produce)
        self.sent = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self._ended.set()
        self._thread.join(patient(_END_S))
        assert not self._thread.is_alive()

    def end(self) -> None:
        """Produce no more; Kafka has all that was produced then."""
        self._ended.set()
        self._thread.join(patient(_END_S))

    def wait_beyond(self, count: int) -> None:
        """Wait until it has produced more than so many: it goes on."""
        eventually(lambda: self.sent > count, _END_S, lambda: f'{self.sent} of {count} are sent')

    @contextmanager
    def held(self) -> Iterator[None]:
        """Produce nothing, with nothing on its way.

        A librdkafka that asks a broker for metadata while that goes down may forget all brokers
        for good: the bridge's clients are replaced then, this one would not be.
        """
        with self._turn:
            eventually(self._all_is_there, _END_S, lambda: f'not all of {self.sent} is there')
            yield

    def _all_is_there(self) -> bool:
        return self._bench.reaches(self._topic, self.sent, self._partition)

    def _produce(self) -> None:
        self._bench.produce(self._topic, self._counted(), partition=self._partition)

    def _counted(self) -> Iterator[bytes]:
        # In this order: no value is taken and then not sent.
        for _, value in zip(self._ticks(), self._values, strict=False):
            with self._turn:
                yield value
                self.sent += 1

    def _ticks(self) -> Iterator[None]:
        start_s = time.monotonic()
        for number in itertools.count():
            time.sleep(max(0.0, start_s + number / self._rate - time.monotonic()))
            if self._ended.is_set():
                return
            yield
