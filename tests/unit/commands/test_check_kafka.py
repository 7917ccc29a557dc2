"""What `check` says of a Kafka that does not answer it all: nothing is new or missing by guess."""

from collections.abc import Iterator
from typing import Any, cast
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.commands.check import kafka as check_kafka
from ros2_kafka_bridge.commands.check.kafka import CheckedCluster
from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.overview import Greeting, GroupMembers, Overview, TopicView
from ros2_kafka_bridge.kafka.partition import Committed
from ros2_kafka_bridge.kafka.topic_id import TopicId

TO_ROS = {'from': {'kafka': 'a', 'group': 'g'}, 'to': {'ros': '/a', 'type': 'std_msgs/msg/String'}}
TO_KAFKA = {'from': {'ros': '/b'}, 'to': {'kafka': 'b'}, 'exclusive': True}
NOW = TopicId('here', 'new')
THERE = TopicView(True, 1, None, '', NOW.topic_id)  # noqa: FBT003 (it exists)
MISSING = TopicView(exists=False, partitions=0, rights=None, problem='unknown topic')
UNSEEN = TopicView(exists=None, partitions=0, rights=None, problem='timed out')


def config(**kafka: str) -> Config:
    routes = [
        {'name': 'in', 'format': 'text', **TO_ROS},
        {'name': 'out', 'format': 'text', **TO_KAFKA},
    ]
    servers = {'bootstrap.servers': 'kafka:9092'}
    return validated(Config, {'name': 'bridge', 'kafka': servers | kafka, 'routes': routes})


def cluster(view: TopicView = THERE, **told: Any) -> CheckedCluster:
    overview = MagicMock(spec=Overview)
    overview.topic.return_value = view
    overview.committed.return_value = told.get('committed', {})
    places = [('a', number) for number in range(view.partitions)]
    overview.begins.return_value = dict.fromkeys(places, told.get('begin', 0))
    overview.ends.return_value = dict.fromkeys(places, 9)
    overview.members.return_value = told.get('members', GroupMembers('', frozenset()))
    return CheckedCluster(cast('Overview', overview), '', True, NOW.cluster_id)  # noqa: FBT003


def of_both(kafka: CheckedCluster, given: Config) -> Iterator[Finding]:
    reads, writes = given.routes
    assert isinstance(reads, KafkaToRosRoute)
    assert isinstance(writes, RosToKafkaRoute)
    yield from check_kafka.source_findings(reads, given, kafka)
    yield from check_kafka.sink_findings(writes, kafka)
    yield from check_kafka.lock_findings(writes, given, kafka)
    yield from check_kafka.dead_letter_findings(writes, kafka)


def test_a_topic_that_cannot_be_asked_for_is_not_missing_and_nobody_is_to_create_it() -> None:
    found = list(of_both(cluster(UNSEEN), config()))
    assert {it.text.partition(' is there is not known: ')[2] for it in found} == {'timed out'}
    levels = [it.level for it in found]
    assert levels == ['bad', 'bad', 'bad', 'note'], 'without dead letters a route runs'
    assert not any('create' in it.cure for it in found)


def test_a_topic_that_is_not_there_by_the_word_of_the_broker_is_to_be_created() -> None:
    source, sink, lock, letters = of_both(cluster(MISSING), config())
    assert (source.level, source.cure) == ('bad', 'create it')
    assert [it.level for it in (sink, lock, letters)] == ['note'] * 3


def group_findings(kafka: CheckedCluster, given: Config) -> list[Finding]:
    [route, _] = given.routes
    assert isinstance(route, KafkaToRosRoute)
    return list(check_kafka.source_findings(route, given, kafka))[1:]


def test_a_group_without_offsets_is_not_called_new() -> None:
    [found] = group_findings(cluster(), config())
    assert found.text == (
        'group g has no committed offsets (it is new, they have expired, or went with a topic '
        'that was deleted): start is latest, only new ones'
    )


@pytest.mark.parametrize('committed', [{}, {0: Committed(3, None)}])
def test_members_of_another_application_are_named_with_the_cure(
    committed: dict[int, Committed],
) -> None:
    """Whether they would let the bridge in is not told: Java's own default does."""
    members = GroupMembers('range', frozenset({'bridge2', 'bridge', 'bridge-worker-2'}))
    *_, found = group_findings(cluster(committed=committed, members=members), config())
    assert found.level == 'note'
    assert 'members of another application (bridge2), which share its partitions by range' in (
        found.text
    )
    assert 'a group of its own' in found.cure


def test_the_bridge_itself_is_no_other_application() -> None:
    own = GroupMembers('cooperative-sticky', frozenset({'robots', 'bridge-worker-2'}))
    assert len(group_findings(cluster(members=own), config())) == 2
    named = GroupMembers('cooperative-sticky', frozenset({'robots'}))
    assert len(group_findings(cluster(members=named), config(**{'client.id': 'robots'}))) == 1


def test_a_group_of_another_kind_is_refused() -> None:
    kafka = cluster()
    cast('Any', kafka.overview).members.side_effect = RouteError('not a consumer group (connect)')
    *_, found = group_findings(kafka, config())
    assert (found.level, found.text) == ('bad', 'not a consumer group (connect)')


@pytest.mark.parametrize(('there', 'levels'), [(2, ['ok', 'bad']), (0, ['bad'])])
def test_brokers_that_do_not_answer_where_the_cluster_names_them_are_told(
    there: int, levels: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    overview = MagicMock()
    overview.return_value.greeting.return_value = Greeting('c', there, ['x:9 does not answer'])
    monkeypatch.setattr(check_kafka, 'Overview', overview)
    kafka, found = check_kafka.ask(config())
    assert [it.level for it in found] == levels
    assert 'advertised.listeners' in found[-1].cure
    assert bool(kafka.problem) == (there == 0)
    assert kafka.cluster_id == 'c'


def test_offsets_behind_the_end_of_a_topic_are_no_negative_number_of_records() -> None:
    [found] = group_findings(cluster(committed={0: Committed(14, NOW)}), config())
    assert found.level == 'note'
    assert found.text.startswith('group g is ahead of a[0]: it was made anew or cut off')
    assert found.text.endswith('the bridge reads all that it holds now, 9 records to deliver')


@pytest.mark.parametrize(
    ('begin', 'left'), [pytest.param(0, 5, id='all there'), pytest.param(7, 2, id='cut off')]
)
def test_what_was_deleted_before_it_was_read_is_not_to_deliver(begin: int, left: int) -> None:
    committed = {0: Committed(4, NOW)}
    [found] = group_findings(cluster(committed=committed, begin=begin), config())
    assert found.level == 'ok'
    assert found.text == f'group g goes on at its committed offsets, {left} records to deliver'


# Which topic the offsets are of

OLD = TopicId('here', 'old')
FOREIGN = TopicId('there', 'old')
THREE = THERE._replace(partitions=3)
GONE = (
    'the offsets of group g at a[0, 2] are of a topic of this name that is gone: the bridge reads '
    'all that is there now'
)
ELSEWHERE = (
    'the offsets of group g at a[0, 2] are of cluster there, and this is cluster here: the bridge '
    'goes on at them'
)


def at_two(of: TopicId | None, offset: int = 4) -> dict[int, Committed]:
    """Offsets of three partitions, the one in the middle of the topic that is there."""
    return {0: Committed(offset, of), 1: Committed(4, NOW), 2: Committed(offset, of)}


@pytest.mark.parametrize('offset', [4, 9, 14])
def test_offsets_of_a_topic_that_is_gone_are_not_called_good(offset: int) -> None:
    """Wherever they are: the bridge reads all that the topic of now holds."""
    [found] = group_findings(cluster(THREE, committed=at_two(OLD, offset)), config())
    assert (found.level, found.cure) == ('note', '')
    assert found.text == f'{GONE}, {9 + 5 + 9} records to deliver'


def test_offsets_of_another_cluster_are_told_with_the_cure() -> None:
    [found] = group_findings(cluster(THREE, committed=at_two(FOREIGN)), config())
    assert found.level == 'note'
    assert found.text == f'{ELSEWHERE}, {3 * 5} records to deliver'
    assert found.cure == (
        'where they do not fit, set others while the bridge is stopped '
        '(kafka-consumer-groups.sh --reset-offsets)'
    )


def test_offsets_of_several_kinds_are_told_each() -> None:
    committed = {0: Committed(4, OLD), 1: Committed(4, FOREIGN), 2: Committed(14, NOW)}
    texts = [it.text for it in group_findings(cluster(THREE, committed=committed), config())]
    assert [text.partition(':')[0] for text in texts] == [
        'the offsets of group g at a[0] are of a topic of this name that is gone',
        'group g is ahead of a[2]',
        'the offsets of group g at a[1] are of cluster there, and this is cluster here',
    ]
    assert all(text.endswith(f', {9 + 5 + 9} records to deliver') for text in texts)


@pytest.mark.parametrize(
    ('view', 'of'),
    [
        pytest.param(THREE, NOW, id='the same'),
        pytest.param(THREE, None, id='of whom it is not told'),
        pytest.param(THREE._replace(topic_id=''), OLD, id='which is there is not told'),
        pytest.param(THREE._replace(topic_id=''), FOREIGN, id='nor where'),
    ],
)
def test_all_other_offsets_are_gone_on_at(view: TopicView, of: TopicId | None) -> None:
    [found] = group_findings(cluster(view, committed=at_two(of)), config())
    assert found.level == 'ok'
    assert found.text == 'group g goes on at its committed offsets, 15 records to deliver'


def test_a_partition_that_came_with_the_new_topic_is_read_from_its_beginning() -> None:
    [found] = group_findings(cluster(THREE, committed={0: Committed(9, OLD)}), config())
    assert found.text.endswith(f', {3 * 9} records to deliver')
