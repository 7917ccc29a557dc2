"""Notices a client that says nothing, and does not read: it is given up, and another begins."""

import time
from collections.abc import Iterable, Mapping
from typing import Final

from confluent_kafka import OFFSET_END, Consumer, KafkaException, TopicPartition

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.client_health import ClientHealth

_OUTSIDE_S: Final = 45.0
_JOINING_S: Final = 8.0  # a session that ends, and an election: what lasts longer is said
_NOT_LET_IN: Final = (
    'Kafka is there and does not let this bridge into its group: the coordinator of the group, or '
    'another member, holds it up'
)
_NO_ANSWER: Final = 'Kafka does not answer: the bridge waits for its place in the group'
_LOOK_EVERY_S: Final = 2.0
_LOOK_S: Final = 0.5
_LONG_LOOK_S: Final = 1.0  # what is not there is said of Kafka
_STUCK_LOOK_S = 10.0
_ANSWER_S: Final = 0.5  # of the broker, behind a fetch


class Watchdog:
    """Watches one client of a group, while nothing comes from it.

    Args:
        topic: That it reads.
        fetch_s: How long a fetch waits at the broker.
    """

    def __init__(self, topic: str, fetch_s: float) -> None:
        self._topic = topic
        self._look_s = fetch_s + _ANSWER_S
        self._outside_since_s: float | None = None  # without a place in the group that it had
        self._joins_since_s: float | None = None  # while Kafka was there
        self.is_there: bool | None = None  # it has answered; None: it was not asked since
        self._behind: dict[
            int, int
        ] = {}  # how far those were read that hold more, at the last look
        self._stuck_look_at_s = 0.0
        self._broker_look_at_s = 0.0

    def begin(self) -> None:
        """Note that there is a new client."""
        self._outside_since_s = None
        self.is_there = None
        self._joins_since_s = time.monotonic()
        self._behind = {}
        self._stuck_look_at_s = time.monotonic() + _STUCK_LOOK_S

    @property
    def reason(self) -> str:
        """Why nothing is read though Kafka seems there; empty while that needs no reason."""
        if not self.joins_for_long or self.is_there is None:
            return ''
        return _NOT_LET_IN if self.is_there else _NO_ANSWER

    @property
    def joins_for_long(self) -> bool:
        """Whether the client waits for its place longer than an election takes."""
        since_s = self._joins_since_s
        return since_s is not None and time.monotonic() - since_s >= _JOINING_S

    @property
    def joins(self) -> bool:
        """Whether the client waits for its place in the group."""
        return self._joins_since_s is not None

    @property
    def is_outside(self) -> bool:
        """Whether the client has lost its place in the group."""
        return self._outside_since_s is not None

    def on_assign(self) -> None:
        """Note that the client is in its group."""
        self._outside_since_s = self._joins_since_s = self.is_there = None

    def on_lost(self) -> None:
        """Note that the client has lost its partitions."""
        self._outside_since_s = self._joins_since_s = time.monotonic()
        self.is_there = None

    def look_for_broker(self, client: Consumer, health: ClientHealth) -> None:
        """Ask whether a broker that was away is back: a quiet topic would not tell.

        Whoever waits for the group asks, too: one that stands still looks as if it were there.
        """
        now_s = time.monotonic()
        if (health.away or self.joins_for_long) and now_s >= self._broker_look_at_s:
            self._broker_look_at_s = now_s + _LOOK_EVERY_S
            within_s = _LOOK_S if health.away else _LONG_LOOK_S
            self.is_there = health.ask(client, self._topic, within_s)

    def look_whether_outside(self, away: str) -> None:
        """Give up a client that does not find back into its group.

        Seen with brokers that stood still for a little longer than the session: librdkafka says
        that the partitions are lost, and then waits for ever.

        Args:
            away: Why Kafka cannot be reached; empty where it can.

        Raises:
            RouteError: It has been outside for too long.
        """
        now_s = time.monotonic()
        if away and self._joins_since_s is not None:
            self._joins_since_s = now_s
        if self._outside_since_s is None:
            return
        if away:
            self._outside_since_s = now_s
        elif now_s - self._outside_since_s > _OUTSIDE_S:
            raise RouteError(
                f'topic {self._topic}: lost its partitions {_OUTSIDE_S:.0f} s ago and does not '
                'get back into its group: begins anew'
            )

    def look_whether_stuck(self, client: Consumer, reached: Mapping[int, int]) -> None:
        """Give up a client that does not read what its partitions hold; looks every ten seconds.

        Seen with topics whose leader was not known yet when their reading began: librdkafka says
        nothing, and never asks for the records.

        Args:
            client: To ask where the partitions end.
            reached: How far each partition was read, of those where that is known.

        Raises:
            RouteError: A partition holds more, as at the last look, and nothing was read since.
        """
        now_s = time.monotonic()
        if now_s < self._stuck_look_at_s:
            return
        self._stuck_look_at_s = now_s + _STUCK_LOOK_S
        ends = self._ends(client, reached)
        behind = {p: at for p, at in reached.items() if ends.get(p, at) > at}
        if any(self._behind.get(partition) == at for partition, at in behind.items()):
            raise RouteError(
                f'topic {self._topic}: holds records that the Kafka client does not read: '
                'begins anew'
            )
        self._behind = behind

    def _ends(self, client: Consumer, partitions: Iterable[int]) -> dict[int, int]:
        """Where partitions end; nothing where a broker does not tell in time.

        One request to each broker: it waits until the fetch before it in the same connection is
        done.
        """
        ends = [TopicPartition(self._topic, number, OFFSET_END) for number in partitions]
        try:
            answers = client.offsets_for_times(ends, timeout=self._look_s) if ends else []
        except KafkaException:  # the broker does not answer: that is another matter
            return {}
        return {answer.partition: answer.offset for answer in answers if answer.error is None}
