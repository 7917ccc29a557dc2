"""What the page is told of Kafka, as it answers, refuses and falls silent."""

from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any, Final

import pytest
from confluent_kafka import KafkaError, KafkaException

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka import overview
from ros2_kafka_bridge.kafka.overview import ClusterState, KafkaTopic, TopicState
from ros2_kafka_bridge.monitoring import sides
from ros2_kafka_bridge.monitoring.sides import Sides

from .conftest import Told

AWAY: Final = 'no broker answers'
Look = Callable[[str], TopicState] | None


class Refused:
    """The answer of a broker that tells nothing of a topic."""

    def __init__(self, code: int) -> None:
        self._error = KafkaException(KafkaError(code))

    def result(self) -> None:
        raise self._error


class Described:
    """The answer of a broker that tells of a topic of one partition."""

    def result(self) -> SimpleNamespace:
        partition = SimpleNamespace(leader=SimpleNamespace(id=1), isr=[1], replicas=[1])
        return SimpleNamespace(partitions=[partition])


def state(topic: str, code: int) -> TopicState:
    return overview._state(topic, Refused(code))


def seen(topic: str) -> TopicState:
    return overview._state(topic, Described())


class Kafka:
    """A cluster that tells this of its topics, one look after another.

    Args:
        looks: What comes of each look; None where nobody answers.
    """

    def __init__(self, looks: Iterable[Look]) -> None:
        self.looks = list(looks)

    def look(self, topics: set[str]) -> ClusterState:
        look = self.looks.pop(0)
        if look is None:
            raise TransportError(AWAY)
        return ClusterState('abc', {1: 'localhost:9'}, 1, 0.1, [look(it) for it in topics])

    def begins(self, topics: list[KafkaTopic]) -> dict[tuple[str, int], int]:
        return {(topic.name, 0): 2 for topic in topics}

    def ends(self, topics: list[KafkaTopic]) -> dict[tuple[str, int], int]:
        return {(topic.name, 0): 7 for topic in topics}


def told_of(told: Told, monkeypatch: pytest.MonkeyPatch, *looks: Look) -> list[dict[str, Any]]:
    """What the page tells of Kafka after each look."""
    kafka, watching, found = Kafka(looks), Sides(told.watch, lambda: None), list[dict[str, Any]]()

    def wait(*_: float) -> None:
        found.append(watching.sections())
        if not kafka.looks:
            watching.__exit__()

    monkeypatch.setattr(sides, 'Overview', lambda _: kafka)
    monkeypatch.setattr(watching._wanted['kafka'], 'wait', wait)
    watching._watch_kafka()
    return found


def test_a_topic_that_this_user_may_not_see_is_not_said_to_be_missing(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes = {
        'orders.dead-letters': KafkaError.TOPIC_AUTHORIZATION_FAILED,
        'returned.dead-letters': KafkaError.UNKNOWN_TOPIC_OR_PART,
    }
    [found] = told_of(
        told, monkeypatch, lambda it: state(it, codes[it]) if it in codes else seen(it)
    )
    hidden, missing = found['letters']
    assert (hidden['there'], hidden['held']) == (None, None)
    assert 'authorization failed' in hidden['problem']
    assert (missing['there'], missing['held']) == (False, None)


def test_nothing_is_counted_of_a_topic_that_cannot_be_seen() -> None:
    found = state('orders', KafkaError.TOPIC_AUTHORIZATION_FAILED)
    assert (found.partitions, found.leaderless, found.under_replicated) == (None, None, None)


def test_what_letters_were_kept_is_not_known_once_kafka_is_away(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, then, again = told_of(told, monkeypatch, seen, None, seen)
    assert [it['held'] for it in first['letters']] == [5, 5]
    assert [(it['there'], it['held']) for it in then['letters']] == [(None, None)] * 2
    assert {it['problem'] for it in then['letters']} == {AWAY}
    assert (then['broker']['cluster_id'], then['broker']['problem']) == ('abc', AWAY)
    assert again['letters'] == first['letters']


def test_a_kafka_that_never_answered_was_asked_all_the_same(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    [found] = told_of(told, monkeypatch, None)
    assert [it['topic'] for it in found['letters']] == [
        'orders.dead-letters', 'returned.dead-letters',
    ]  # fmt: skip
    assert found['broker'] == {'problem': AWAY, 'seen_s': None}
