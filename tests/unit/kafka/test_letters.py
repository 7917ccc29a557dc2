"""A dead-letter topic of which not all can be seen is not one that holds nothing."""

import json
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from confluent_kafka import KafkaError, TopicPartition
from support.bridges.made_letters import TOPIC, config, kafka_letter, stored

from ros2_kafka_bridge.commands.dead_letters import replay, report
from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery
from ros2_kafka_bridge.dead_letters.filter import LetterFilter
from ros2_kafka_bridge.dead_letters.letter import LetterPlace
from ros2_kafka_bridge.errors import ConfigError, RouteError, TransportError
from ros2_kafka_bridge.kafka import letters as under_test
from ros2_kafka_bridge.kafka import ranges
from ros2_kafka_bridge.kafka.letters import LetterReader
from ros2_kafka_bridge.kafka.overview import KafkaTopic
from ros2_kafka_bridge.monitoring import letters as page

QUERY = LetterQuery(config(), TOPIC, LetterFilter())
HIDDEN = f'{TOPIC}[0] is not seen from offset 3 on, neither letters nor marks of replays: a trans'
_READ = ('partition', 'offset', 'key', 'value', 'headers', 'timestamp')
DRY_RUN = replay.ReplayOptions(to_ros=False, dry_run=True, again=False, force=False, all=True)


def message(at: int, code: int | None = None) -> Any:
    record = stored(kafka_letter(), at)
    error = None if code is None else KafkaError(code)
    return SimpleNamespace(
        **{name: getattr(record, name) for name in _READ}, topic=lambda: TOPIC, error=lambda: error
    )


class Kafka:
    """A dead-letter topic with letters, as overview and as consumer; `stable` is seen of it."""

    def __init__(self, end: int, stable: int) -> None:
        self.end, self.stable, self.at = end, stable, 0
        self.topic = KafkaTopic(TOPIC, 1, '')
        self.error: KafkaError | None = None

    def topics(self) -> list[KafkaTopic]:
        return [self.topic]

    def ends(self, _: Any) -> dict[tuple[str, int], int]:
        return {(TOPIC, 0): self.end}

    def list_topics(self, topic: str, timeout: float) -> Any:
        del timeout
        partitions = {} if self.error else {0: None, 1: None}
        return SimpleNamespace(
            topics={topic: SimpleNamespace(error=self.error, partitions=partitions)}
        )

    def get_watermark_offsets(self, _: Any, timeout: float) -> tuple[int, int]:
        del timeout
        return 0, self.stable

    def offsets_for_times(self, _: Any, timeout: float) -> list[TopicPartition]:
        del timeout
        return [TopicPartition(TOPIC, 0, -1)]  # nothing that can be seen is as young

    def assign(self, places: Sequence[TopicPartition]) -> None:
        self.at = places[0].offset

    def consume(self, *_: Any) -> list[Any]:
        found = [message(at) for at in range(self.at, self.stable)]
        self.at = self.stable
        return [*found, message(self.stable, KafkaError._PARTITION_EOF)]

    def close(self) -> None:
        """Nothing is held."""


@pytest.fixture
def kafka(monkeypatch: pytest.MonkeyPatch) -> Kafka:
    """Twenty letters, of which three are before a transaction that has not ended."""
    made = Kafka(end=20, stable=3)
    monkeypatch.setattr(ranges, 'Consumer', lambda *_, **__: made)
    for module in (report, replay, page):
        monkeypatch.setattr(module, 'open_reader', lambda _: reader(made))
    return made


def reader(kafka: Kafka) -> LetterReader:
    return LetterReader({}, kafka)  # type: ignore[arg-type]


@pytest.mark.parametrize('since_ms', [None, 1])
def test_what_an_open_transaction_hides_is_noted(kafka: Kafka, since_ms: int | None) -> None:
    with reader(kafka) as opened:
        assert len(list(opened.letters(TOPIC, since_ms))) == (0 if since_ms else 3)
        assert opened.unseen == {(TOPIC, 0): LetterPlace(TOPIC, 0, 3)}
    with reader(kafka) as opened:
        assert len(list(opened.newest(TOPIC, 2, math.inf))) == 2
        assert list(opened.unseen.values()) == [LetterPlace(TOPIC, 0, 3)]
    kafka.stable = 20
    with reader(kafka) as opened:
        assert len(list(opened.letters(TOPIC))) == 20
        assert not opened.unseen


def test_whoever_must_know_each_mark_is_told_that_young_ones_are_hidden(
    kafka: Kafka, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(under_test, '_SILENT_S', 0.01)
    with reader(kafka) as opened, pytest.raises(TransportError, match='has not ended its transac'):
        list(opened.letters(TOPIC, since_ms=1, whole=True))


@pytest.mark.parametrize('stable', [0, 3])
def test_list_says_from_where_on_it_has_not_seen(
    kafka: Kafka, capsys: pytest.CaptureFixture[str], stable: int
) -> None:
    kafka.stable = stable
    hidden = HIDDEN.replace('3', str(stable))
    assert report.list_letters(QUERY, as_json=False) == 0
    shown = capsys.readouterr().out
    assert hidden in shown
    assert shown.startswith('Dead letters' if stable else 'no dead letters seen (looked at ')
    report.list_letters(QUERY, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told['unseen'] == [{'topic': TOPIC, 'partition': 0, 'offset': stable}]


def test_a_letter_that_may_be_hidden_is_not_said_to_be_none(kafka: Kafka) -> None:
    query = QUERY._replace(filter=LetterFilter(partition=0, offset=7))
    with pytest.raises(TransportError, match=r'seen at offset 7 .* not seen from offset 3'):
        report.show_letters(query, raw=False)
    with pytest.raises(TransportError, match='not seen from offset 3'):
        replay.replay(query, DRY_RUN)
    kafka.end = 3
    with pytest.raises(ConfigError, match='no dead letters at offset 7'):
        report.show_letters(query, raw=False)


def test_a_dry_run_says_what_it_has_not_seen(
    kafka: Kafka, capsys: pytest.CaptureFixture[str]
) -> None:
    kafka.stable = 0
    assert replay.replay(QUERY, DRY_RUN) == 0
    assert 'no dead letters seen' in capsys.readouterr().out


def test_the_page_is_told_what_it_does_not_see(kafka: Kafka) -> None:
    told = page.newest(config(), TOPIC)
    assert told['seen'] == 3
    assert [text.startswith(HIDDEN) for text in told['unseen']] == [True]
    kafka.stable = 20
    assert page.newest(config(), TOPIC)['unseen'] == []


def test_the_page_waits_for_no_silent_partition_and_says_where_it_has_ended(
    kafka: Kafka, monkeypatch: pytest.MonkeyPatch
) -> None:
    kafka.topic = KafkaTopic(TOPIC, 2, '')
    coming = [[message(0), message(1)]]
    monkeypatch.setattr(kafka, 'consume', lambda *_: coming.pop() if coming else [])
    monkeypatch.setattr(kafka, 'ends', lambda _: {(TOPIC, 0): 20, (TOPIC, 1): 20})
    monkeypatch.setattr(page, '_READING_S', 0.05)
    monkeypatch.setattr(under_test, '_SILENT_S', 5.0)
    told = page.newest(config(), TOPIC)
    [said] = told['unseen']
    assert told['seen'] == 2
    assert 'up to offset 2 of partition 0; ros2-kafka-bridge dead-letters list reads all' in said


@pytest.mark.parametrize(
    ('code', 'error'),
    [
        (KafkaError.LEADER_NOT_AVAILABLE, TransportError),
        (KafkaError.REQUEST_TIMED_OUT, TransportError),
        (KafkaError.TOPIC_AUTHORIZATION_FAILED, RouteError),
        (KafkaError.TOPIC_EXCEPTION, RouteError),
    ],
)
@pytest.mark.parametrize('listed', [True, False])
def test_a_topic_of_which_the_broker_does_not_tell_is_not_said_to_be_missing(
    kafka: Kafka, code: int, error: type[Exception], *, listed: bool
) -> None:
    kafka.topic = KafkaTopic(TOPIC if listed else 'another', 0, 'some error')
    kafka.error = KafkaError(code)
    with pytest.raises(error, match=f'topic {TOPIC}: '):
        report.find(QUERY)


def test_a_topic_is_missing_where_the_broker_says_so_and_there_as_soon_as_it_is(
    kafka: Kafka,
) -> None:
    kafka.topic = KafkaTopic('another', 1, '')
    with reader(kafka) as opened:
        kafka.error = KafkaError(KafkaError.UNKNOWN_TOPIC_OR_PART)
        assert not opened.has(TOPIC)
        kafka.error = None
        assert opened.has(TOPIC)
        assert opened.partitions[TOPIC] == 2


def test_a_place_in_a_topic_that_the_broker_does_not_tell_of_is_not_denied(kafka: Kafka) -> None:
    kafka.topic = KafkaTopic('orders', 0, 'Leader not available')
    with reader(kafka) as opened, pytest.raises(RouteError, match='not there, or this user may'):
        opened.bounds('orders', 2, 5)
