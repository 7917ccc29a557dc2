"""What a Kafka client says of itself, kept until somebody asks."""

import time
from typing import Final

from confluent_kafka import Consumer, KafkaError, KafkaException

from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka.errors import Client, Problem, explain, translate
from ros2_kafka_bridge.kafka.statistics import Statistics
from ros2_kafka_bridge.logs.lines import Log

_TOLD_AGAIN_S: Final = 60.0
BLIP_S: Final = 1.0  # a connection that is made anew looks as if no broker answered
_WITHOUT_S: Final = 1.0  # it knows none for a moment, too, before it tries bootstrap.servers again
BROKERS_LOST: Final = 'the Kafka client has forgotten all brokers: begins anew with another'


class ClientHealth:
    """Keeps what a client says of itself in its callbacks, for the route's own thread.

    Used by the thread that polls the client: librdkafka calls back from there.

    Args:
        where: What to call the client in errors.
        log: Where to say that Kafka is away.
        client: What an error does not tell of it.
        reads: Whether it reads: then an error of one broker counts once the next report shows
            none at all, for the partitions of the others are read on. What is sent may wait for
            the one.
    """

    def __init__(
        self,
        where: str,
        log: Log,
        client: Client,
        *,
        reads: bool = False,
    ) -> None:
        self._where = where
        self._reads = reads
        self._log = log
        self._client = client
        self._failure: KafkaError | None = None
        self._cause: Problem | None = None  # of being away
        self._suspect: Problem | None = None  # of one broker, until it is known of all
        self._away_since_s = 0.0
        self._told: dict[str, float] = {}
        self._said = ''  # of being away, since the last contact
        self._without_since_s: float | None = None  # a report of no broker, and none of any since
        self.has_lost_brokers = False
        self.is_connected = False  # to a broker, at the last report
        self.reached = False  # any broker, by any of its clients
        self.is_heard = False  # of a broker, by this client
        self.away = ''

    @property
    def away_for_s(self) -> float:
        """For how long Kafka has been away; 0 where it is not."""
        return time.monotonic() - self._away_since_s if self.away else 0.0

    @property
    def has_failed(self) -> bool:
        """Whether something has made the client useless."""
        return self._failure is not None

    def on_open(self) -> None:
        """Forget what the client before has said: this one speaks for itself."""
        self.away = self._said = ''
        self.on_new_client()

    def on_new_client(self) -> None:
        """Note that another client has taken the place of one that was of no use any more."""
        self._failure = self._without_since_s = self._suspect = None
        self.has_lost_brokers = self.is_connected = self.is_heard = False

    def on_statistics(self, statistics: Statistics) -> None:
        """Take a report of the client (librdkafka's statistics callback).

        `has_lost_brokers` tells then whether it has forgotten all brokers, and would never connect
        to any again. Where the only broker goes down in order, its last answers name no broker.
        librdkafka forgets those it knew, and should begin with bootstrap.servers; now and then it
        cancels that itself (since 2.13, its issue 5301).
        """
        now_s = time.monotonic()
        self.is_connected = statistics.is_connected
        self.reached = self.reached or statistics.is_connected
        self.is_heard = self.is_heard or statistics.is_connected
        if statistics.knows_brokers:
            self._without_since_s = None
        elif self._without_since_s is None:
            self._without_since_s = now_s
        since_s = self._without_since_s
        self.has_lost_brokers = since_s is not None and now_s - since_s >= _WITHOUT_S
        suspect, self._suspect = self._suspect, None
        if suspect is not None:
            self._judge(suspect)

    def on_error(self, error: KafkaError) -> None:
        """Take an error of the client (librdkafka's error callback)."""
        problem = explain(error, self._client._replace(is_reached=self.reached))
        if issubclass(problem.kind, RouteError):
            self._failure = self._failure or error
        elif issubclass(problem.kind, TransportError) and self._is_news(problem):
            if self._reads and self.is_connected and problem.is_of_one:
                self._suspect = problem  # another may be there: the next report tells
            else:
                self._note_away(problem)

    def _note_away(self, problem: Problem) -> None:
        if not self.away:
            self._away_since_s = time.monotonic()
        self._cause = problem
        self.away = f'Kafka is away: {problem.sentence}'

    def _judge(self, suspect: Problem) -> None:
        """Tell whether an error of one broker means that Kafka is away: not where one is there."""
        if not self.is_connected and self._is_news(suspect):
            self._note_away(suspect)
        elif self.is_connected and self._is_due(suspect.sentence):
            self._log.warning('a broker of the cluster does not answer: %s', suspect.sentence)

    def on_contact(self) -> None:
        """Note that the broker has answered."""
        self.reached = self.is_heard = True
        if self.away:
            self.away = ''
            if self._said:
                self._log.info('Kafka is back')
            self._said = ''

    def ask(self, client: Consumer, topic: str, within_s: float) -> bool:
        """Ask whether the broker is there: where nothing is read or sent, nothing else tells.

        Not every answer says so: one from bootstrap.servers may name brokers that do not answer.
        Whether one does is known as of the last report, up to two seconds ago.
        """
        try:
            client.list_topics(topic, timeout=within_s)
        except KafkaException:
            return False
        if self.is_connected:
            self.on_contact()
        return self.is_connected

    def fail(self, error: KafkaError, what: str) -> None:
        """Take what has made the client useless, whatever it is.

        Args:
            error: Of the client.
            what: It means.
        """
        self._failure = self._failure or KafkaError(error.code(), f'{what}: {error.str()}')

    def forget_failure(self) -> None:
        """Forget what had made the client useless: it is of use again."""
        self._failure = None

    def raise_failure(self, blip_s: float = BLIP_S) -> None:
        """Raise what made the client useless, if anything did, or say that Kafka is away.

        Args:
            blip_s: How long it has to be before that is said.
        """
        failure, self._failure = self._failure, None
        if failure is not None:
            raise translate(failure, self._where, self._client)
        if self.away not in {'', self._said} and self._due(blip_s):
            self._said = self.away
            self._log.warning('%s; trying again until it is back', self.away)

    def _is_news(self, problem: Problem) -> bool:
        """Whether it says more than is known: the first, or the cause of it."""
        known = self._cause if self.away else None
        return known is None or (problem.names_cause and not known.names_cause)

    def _due(self, blip_s: float) -> bool:
        """Whether to say that Kafka is away: once a minute where the cause is the same.

        While an old token holds, records go on between two requests for a new one that fail.
        """
        if self._cause is None or not self._cause.names_cause:
            return time.monotonic() - self._away_since_s >= blip_s
        return self._is_due(self.away)

    def _is_due(self, text: str) -> bool:
        """Whether it was not said in the last minute."""
        now_s = time.monotonic()
        due = now_s - self._told.get(text, -_TOLD_AGAIN_S) >= _TOLD_AGAIN_S
        if due:
            self._told[text] = now_s
        return due
