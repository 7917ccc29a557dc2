"""Notices that the topic of a reader was made anew, or lies in another cluster, and says so."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from ros2_kafka_bridge.errors import About
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.topic_id import ANSWER_S, Question, TopicId, TopicIds
from ros2_kafka_bridge.logs.lines import Log

_SOON_S: Final = 1.0  # no second answer is waited for
_ANEW: Final = (
    '%s was made anew: the offsets that the bridge has are of a topic with the id %s, it has the '
    'id %s now: the bridge reads all that it holds'
)
_ELSEWHERE: Final = (
    '%s: the committed offsets are of cluster %s, and this is cluster %s: goes on at them; where '
    'they do not fit, kafka-consumer-groups.sh --reset-offsets sets others, while the bridge is '
    'stopped'
)


class TopicWatch:
    """Compares the topic that is there with the one that the offsets of a reader are of.

    librdkafka tells nothing: it goes on at the old offset, or, where the leader of the old
    partition had changed, asks for ever for a leader epoch that the new one has not.

    What is compared, each with the topic that is there:

    - `Partition.of`, of the offsets of one partition: one that has just come begins at 0, for one
      that is read the client is of no use any more.
    - `known`, the last that was there: it outlives clients and runs of a route, as Kafka deletes
      the offsets of a group with the topic. All that the new one holds is new.
    - `_read`, as `known`, but forgotten with the client.

    Args:
        ids: Whom to ask.
        offsets: Of the partitions that the reader has.
        log: Where to say what happens.
        on_new: Called where all that the topic holds is new.
    """

    def __init__(
        self,
        ids: TopicIds,
        offsets: Offsets,
        log: Log,
        on_new: Callable[[], None],
    ) -> None:
        self._topic = offsets.topic
        self._ids = ids
        self._offsets = offsets
        self._log = log
        self._on_new = on_new
        self.known: TopicId | None = None
        self._read: TopicId | None = None
        self._past: set[TopicId | None] = set()  # a broker that is cut off may still tell of them
        self._is_due = False
        self._asked_at_s = self._waited_at_s = -_SOON_S
        self._is_silent = False  # who is asked
        self._question: Question | None = None

    @property
    def is_asking(self) -> bool:
        """Whether it has a question, or waits for an answer."""
        return self._is_due or self._question is not None

    def begin(self) -> None:
        """Note that there is a new client, which knows no topic yet."""
        self._read = self._question = None
        self._is_due = False

    def on_metadata(self, age_s: float | None) -> None:
        """Ask again if the client was told of its topic since: it reads no other before that.

        Args:
            age_s: How long ago that was; None where it never was.
        """
        self._ids.serve()
        if age_s is None:  # a reader without partitions, which may get them of another topic
            self._is_due = self._is_due or self.known is None
        elif time.monotonic() - age_s > self._asked_at_s:
            self._is_due = True

    def is_replaced(self, *, at_once: bool = False) -> bool:
        """Whether the topic was made anew since the client began to read it, if it reads at all.

        Args:
            at_once: Wait for the answer, also where the client was told nothing new.
        """
        if (now := self._wait_once() if at_once else self._look()) is None:
            return False
        of = [partition.of for partition in self._offsets]
        if self._tell_replaced([self.known, *of], now):
            self.known = now
            return len(self._offsets) > 0
        self._settle_on(now, of)
        return False

    def find_gone(self, told: Mapping[int, TopicId | None]) -> frozenset[int]:
        """Find the partitions whose committed offsets are of a topic that is gone.

        Args:
            told: Which topic those of the partitions that have just come are of; None where
                nobody has said so.
        """
        held = [self._read, *(it.of for it in self._offsets if it.number not in told)]
        for number, of in told.items():
            self._offsets[number].of = of
        if (now := self._wait()) is None:
            self._is_due = True  # nobody waits for the next answer
            return frozenset()
        if any(map(now.has_replaced, held)):
            self._is_due = True  # of no use for these, either: another client reads all
            return frozenset()
        gone = frozenset(number for number, of in told.items() if now.has_replaced(of))
        self._tell_replaced([self.known, *told.values()], now)
        self._settle_on(now, told.values())
        return gone

    def _look(self) -> TopicId | None:
        """What a question has brought that was asked when it was due; nobody waits for it."""
        if self._is_due and self._question is None:
            self._ask()
        if self._question is None or not self._question.is_answered:
            return None
        return self._answer(0.0)

    def _wait_once(self) -> TopicId | None:
        """Ask at once, but not again for each partition."""
        if time.monotonic() - self._waited_at_s < _SOON_S:
            return None
        found = self._wait()
        self._waited_at_s = time.monotonic()
        return found

    def _wait(self) -> TopicId | None:
        """Ask, and wait for it; but who has not answered may never (librdkafka's mock cluster)."""
        if self._is_silent:
            self._is_due = True
            return self._look()
        self._ask()
        return self._answer(ANSWER_S)

    def _ask(self) -> None:
        self._is_due, self._asked_at_s = False, time.monotonic()
        self._question = self._ids.ask(self._topic)

    def _answer(self, within_s: float) -> TopicId | None:
        found = self._ids.answer(self._question, within_s)
        self._is_silent = found is None
        if self._question is not None and self._question.is_answered:
            self._question = None
        return None if found in self._past else found

    def _tell_replaced(self, known: Iterable[TopicId | None], now: TopicId) -> bool:
        """Say that the topic has replaced one of those that are known, if it has."""
        old = next((of for of in known if of is not None and now.has_replaced(of)), None)
        if old is None:
            return False
        self._past.add(old)
        self._on_new()
        self._log.error(
            _ANEW, self._topic, old.topic_id, now.topic_id, extra={'about': About(self._topic)}
        )
        return True

    def _settle_on(self, now: TopicId, known: Iterable[TopicId | None]) -> None:
        """Take all offsets for those of the topic that is there; say whose they were."""
        others = (of for of in known if of is not None and now.is_elsewhere(of))
        if (other := next(others, None)) is not None:
            self._log.warning(_ELSEWHERE, self._topic, other.cluster_id, now.cluster_id)
        self.known = now
        self._read = now if self._offsets else None
        for partition in self._offsets:
            partition.of = now
