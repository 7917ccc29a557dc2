"""Which topic offsets are of, and what is made of one that is another by now."""

import itertools
import logging
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException
from support.kafka.source_stubs import NEW, OLD, ToldIds

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka import topic_id as under_test
from ros2_kafka_bridge.kafka import topic_watch
from ros2_kafka_bridge.kafka.offsets import Offsets
from ros2_kafka_bridge.kafka.topic_id import ANSWER_S, TopicId, TopicIds
from ros2_kafka_bridge.kafka.topic_watch import TopicWatch

ELSEWHERE = TopicId('elsewhere', 'old')
LOG = logging.LoggerAdapter(logging.getLogger('watch'), {})


@pytest.fixture(autouse=True)
def _a_minute_passes_at_each_look_at_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    minutes = itertools.count(1)
    clock = SimpleNamespace(monotonic=lambda: 60.0 * next(minutes))
    monkeypatch.setattr(topic_watch, 'time', clock)


class House:
    """A watch of a topic with the partitions 0 and 1."""

    def __init__(self, *told: TopicId | None) -> None:
        self.ids = ToldIds(*told)
        self.offsets = Offsets('t', LOG)
        self.on_new = MagicMock()
        self.watch = TopicWatch(self.ids, self.offsets, LOG, self.on_new)

    def assign(self, *committed: TopicId | None, first: int = 0) -> frozenset[int]:
        told = dict(enumerate(committed, first))
        self.offsets.assign(told)
        return self.watch.find_gone(told)

    @property
    def of(self) -> list[TopicId | None]:
        return [partition.of for partition in self.offsets]


@pytest.mark.parametrize('committed', [NEW, None, ELSEWHERE])
def test_offsets_count_that_are_of_this_topic_of_another_cluster_or_of_none_that_is_known(
    committed: TopicId | None, caplog: pytest.LogCaptureFixture
) -> None:
    house = House(NEW)
    assert house.assign(committed, committed) == frozenset()
    assert house.of == [NEW, NEW], 'by then, those who commit know what they commit'
    house.on_new.assert_not_called()
    assert caplog.text.count('are of cluster elsewhere, and this is cluster here') == (
        committed is ELSEWHERE
    )
    assert not house.watch.is_replaced(at_once=True)


def test_offsets_of_a_topic_that_is_gone_count_no_more(caplog: pytest.LogCaptureFixture) -> None:
    house = House(NEW)
    assert house.assign(OLD, NEW) == frozenset({0})
    house.on_new.assert_called_once_with()
    assert 't was made anew' in caplog.text
    assert 'id old, it has the id new now' in caplog.text
    assert house.of == [NEW, NEW]


def test_what_nobody_tells_is_as_it_was() -> None:
    house = House(None)
    assert house.assign(OLD, None) == frozenset()
    assert house.of == [OLD, None], 'and whoever commits says so again'
    assert not house.watch.is_replaced(at_once=True)
    house.ids.told = (NEW,)
    assert house.watch.is_replaced(at_once=True)


def test_a_topic_made_anew_while_it_is_read_needs_another_client() -> None:
    house = House(OLD, NEW)
    assert house.assign(None, None) == frozenset()
    assert not house.watch.is_replaced(), 'the client was told nothing new'
    house.watch.on_metadata(0.0)
    assert house.watch.is_replaced()
    house.on_new.assert_called_once_with()
    house.watch.begin()
    house.offsets.clear()
    assert house.assign(None, OLD) == frozenset({1}), 'another reader has not noticed'
    assert not house.watch.is_replaced(at_once=True)


@pytest.mark.parametrize('told', [None, OLD, NEW])
def test_partitions_that_come_of_a_topic_made_anew_need_another_client_too(
    told: TopicId | None,
) -> None:
    house = House(OLD, NEW)
    house.assign(None)
    assert house.assign(told, first=1) == frozenset()
    assert house.watch.is_replaced()


def test_a_topic_made_anew_between_two_runs_of_a_route_is_new_though_no_offset_says_so() -> None:
    house = House(OLD, NEW)
    house.assign(None)
    house.offsets.clear()
    house.watch.begin()
    assert house.assign(None) == frozenset()
    house.on_new.assert_called_once_with()
    assert not house.watch.is_replaced(at_once=True)


def test_a_client_that_was_told_nothing_since_is_not_asked_about_again() -> None:
    house = House(NEW)
    house.assign(None)
    for age_s in (None, 3600.0, 181.0):
        house.watch.on_metadata(age_s)
        assert not house.watch.is_replaced()
    assert house.ids.asked == 1
    house.watch.on_metadata(1.0)
    for _ in range(3):
        assert not house.watch.is_replaced()
    assert house.ids.asked == 2


def test_another_cluster_that_answers_meanwhile_keeps_the_offsets_and_is_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    house = House(ELSEWHERE, NEW)
    house.assign(None, None)
    for _ in range(3):
        assert not house.watch.is_replaced(at_once=True)
    assert caplog.text.count('cluster elsewhere, and this is cluster here') == 1
    house.on_new.assert_not_called()


def test_a_reader_without_partitions_knows_the_topic_that_it_may_get_them_of() -> None:
    """Kafka deletes the offsets of the group with the topic: nothing else tells at a take-over."""
    house = House(OLD, NEW)
    for _ in range(3):
        house.watch.on_metadata(None)
        assert not house.watch.is_replaced()
    assert house.ids.asked == 1
    assert house.assign(None) == frozenset()
    house.on_new.assert_called_once_with()
    assert not house.watch.is_replaced(), 'its client has read nothing of the old one'


def test_a_reader_without_partitions_goes_on_where_the_other_was_in_the_new_topic() -> None:
    house = House(OLD, NEW)
    house.watch.on_metadata(None)
    assert not house.watch.is_replaced()
    house.watch.on_metadata(0.0)
    assert not house.watch.is_replaced(), 'it has nothing that it could leave'
    house.on_new.assert_called_once_with()
    assert house.assign(NEW) == frozenset()
    assert house.of == [NEW]


def test_a_broker_that_has_not_heard_of_the_new_topic_makes_nothing_begin_again() -> None:
    house = House(OLD, NEW, OLD, NEW)
    house.assign(None)
    assert house.watch.is_replaced(at_once=True)
    house.watch.begin()
    house.offsets.clear()
    assert house.assign(NEW) == frozenset(), 'the word of the broker that is cut off'
    assert not house.watch.is_replaced(at_once=True)
    house.on_new.assert_called_once_with()


def test_nobody_waits_for_an_answer_while_records_come() -> None:
    house = House(NEW)
    house.assign(None)
    house.ids.told = (None, OLD)
    late = MagicMock(is_answered=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(house.ids, 'ask', lambda _: late)
        house.watch.on_metadata(0.0)
        for _ in range(3):
            assert not house.watch.is_replaced()
    late.answer.assert_not_called()
    late.is_answered, late.answer.return_value = True, TopicId('here', 'another')
    assert house.watch.is_replaced()


def test_an_offset_that_is_gone_of_each_partition_is_asked_about_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House(NEW)
    house.assign(None, None)
    monkeypatch.setattr(topic_watch, 'time', SimpleNamespace(monotonic=lambda: 60.5))
    for _ in range(12):
        assert not house.watch.is_replaced(at_once=True)
    assert house.ids.asked == 2


def test_who_has_not_answered_is_not_waited_for_again_until_he_does() -> None:
    """The oldest records of a topic would be deleted meanwhile, one wait after another."""
    house = House(None)
    late = MagicMock(is_answered=False)
    late.answer.side_effect = TimeoutError
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(house.ids, 'ask', lambda _: late)
        house.assign(None)
        for _ in range(3):
            assert not house.watch.is_replaced(at_once=True)
        late.answer.assert_called_once_with(ANSWER_S)
    late.is_answered, late.answer.side_effect, late.answer.return_value = True, None, OLD
    assert not house.watch.is_replaced()
    house.ids.told = (NEW,)
    assert house.watch.is_replaced(at_once=True)


# What is written beside an offset


def test_metadata_says_which_topic_an_offset_is_of() -> None:
    for of in (NEW, TopicId('c' * 2000, 't'), TopicId('with "quotes"', 'ä\n')):
        assert TopicId.of_metadata(of.metadata) == of


@pytest.mark.parametrize(
    'text',
    [
        None, '', 'null', '0', '[]', '{}', '""', '{"cluster_id":"a"}', '{"topic_id":"a"}',
        '{"cluster_id":1,"topic_id":"a"}', '{"cluster_id":null,"topic_id":null}',
        '{"cluster_id":"a","topic_id":"b"', '\ud800', '[' * 5000, '{"cluster_id":' * 5000,
        '{"cluster_id":"' + 'a' * 5000 + '","topic_id":"b"}', '{"cluster_id":"","topic_id":"b"}',
        '{"cluster_id":"a","topic_id":""}', NEW.metadata[:-1] + '}}',
    ],
)  # fmt: skip
def test_anything_else_beside_an_offset_says_nothing(text: str | None) -> None:
    assert TopicId.of_metadata(text) is None


# Who tells


def cluster(monkeypatch: pytest.MonkeyPatch, topic: str, cluster_id: str | None) -> MagicMock:
    requests = MagicMock()
    requests.describe_topics.return_value = {'t': MagicMock()}
    requests.describe_topics.return_value['t'].result.return_value.topic_id = topic
    requests.describe_cluster.return_value.result.return_value.cluster_id = cluster_id
    monkeypatch.setattr(under_test, 'Admin', MagicMock(return_value=MagicMock(requests=requests)))
    return requests


def test_a_cluster_is_asked_by_one_client(monkeypatch: pytest.MonkeyPatch) -> None:
    cluster(monkeypatch, 'new', 'here')
    ids = TopicIds({})
    assert [ids.answer(ids.ask('t'), 1.0) for _ in range(3)] == [NEW] * 3
    assert under_test.Admin.call_count == 1  # type: ignore[attr-defined]


@pytest.mark.parametrize(('topic', 'cluster_id'), [('A' * 22, 'here'), ('new', None), ('new', '')])
def test_a_cluster_without_ids_tells_none(
    monkeypatch: pytest.MonkeyPatch, topic: str, cluster_id: str | None
) -> None:
    """As one before Kafka 2.8."""
    cluster(monkeypatch, topic, cluster_id)
    ids = TopicIds({})
    assert ids.answer(ids.ask('t'), 1.0) is None


@pytest.mark.parametrize(
    ('error', 'clients'),
    [
        (KafkaException(KafkaError(KafkaError.TOPIC_AUTHORIZATION_FAILED)), 1),
        (KafkaException(KafkaError(KafkaError._TIMED_OUT)), 2),
        (TimeoutError(), 1),
    ],
)
def test_a_cluster_that_does_not_answer_or_must_not_tells_none(
    monkeypatch: pytest.MonkeyPatch, error: Exception, clients: int
) -> None:
    """Who has got no answer asks with another client the next time."""
    answer = cluster(monkeypatch, 'new', 'here').describe_topics.return_value['t'].result
    ids = TopicIds({})
    answer.side_effect = error
    assert ids.answer(ids.ask('t'), 1.0) is None
    answer.side_effect = None
    assert ids.answer(ids.ask('t'), 1.0) == NEW
    assert under_test.Admin.call_count == clients  # type: ignore[attr-defined]


def test_files_that_cannot_be_read_tell_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, 'Admin', MagicMock(side_effect=RouteError('ca.pem')))
    ids = TopicIds({})
    assert ids.ask('t') is None
    assert ids.answer(None) is None


def test_what_a_client_has_to_say_is_taken_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would pile up for as long as no broker is there."""
    requests = cluster(monkeypatch, 'new', 'here')
    ids = TopicIds({})
    ids.serve()
    requests.poll.assert_not_called()
    ids.ask('t')
    ids.serve()
    requests.poll.assert_called_once_with(0)
