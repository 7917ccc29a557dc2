"""Whatever a call of a foreign library raises, an end raises an error of the bridge or none.

Guarantee 5: only the route of that call fails. Each call that an end makes in its life fails once
here, one after the other; `tests/system/test_foreign_errors.py` does the same to a running bridge.
"""

import contextlib
import itertools
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from unittest.mock import DEFAULT, MagicMock

import pytest
from confluent_kafka import KafkaError, KafkaException, TopicPartition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from support.ros.ends import end_of, source_of, still_node, writer_of

from ros2_kafka_bridge import wiring as wiring_module
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.kafka import admin, group_client, lock, producer, ranges
from ros2_kafka_bridge.kafka.consumer import KafkaSource
from ros2_kafka_bridge.kafka.lock import GroupLock
from ros2_kafka_bridge.kafka.producer import KafkaSink
from ros2_kafka_bridge.kafka.tail import KafkaTail
from ros2_kafka_bridge.kafka.topic_id import TopicIds
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.probe import Abilities
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Wiring

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
TYPE = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)
KAFKA = {'bootstrap.servers': 'localhost:1', 'session.timeout.ms': 6000}
HERE = TopicPartition('t', 0, 5)
OF_EACH = 5

Library = MagicMock
Life = Callable[[Library], Iterator[Callable[[], object]]]
"""The calls on an end, from its opening to its closing, over a library."""


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = ((group_client, '_JOIN_S'), (group_client, '_DRAIN_S'), (lock, '_REQUEST_S'))
    for module, limit in limits:
        monkeypatch.setattr(module, limit, 0.02)
    monkeypatch.setattr(lock, '_AGAIN_S', 0.0)


def kafka_source(client: Library) -> Iterator[Callable[[], object]]:
    """A source that has a partition, is held, and hands it over."""
    client.poll.return_value = None
    client.assignment.return_value = [HERE]
    client.committed.return_value = [HERE]
    client.get_watermark_offsets.return_value = (0, 9)
    client.position.return_value = [HERE]
    client.list_topics.return_value.topics = {'t': MagicMock(error=None, partitions=[0])}
    source = KafkaSource(KAFKA, 't', 'earliest', TopicIds(KAFKA), LOG)
    yield lambda: source.open(MagicMock())
    yield lambda: call_back(client, 'on_assign')
    yield lambda: source.poll(10, 0.0)
    client.poll.return_value = record()
    client.consume.return_value = [record(), error(KafkaError._AUTO_OFFSET_RESET)]
    yield lambda: source.poll(10, 0.0)
    client.poll.return_value = None
    yield source.stay
    yield source.lag
    yield lambda: source.advance({0: 6})
    yield source.commit
    yield lambda: source.poll(10, 0.0)
    yield lambda: setattr(source._member._watchdog, '_stuck_look_at_s', 0.0)
    yield lambda: source.poll(10, 0.0)
    yield lambda: source.advance({0: 7})
    yield lambda: source.commit_now(0.01)
    yield lambda: source.advance({0: 8})
    yield lambda: call_back(client, 'on_revoke')
    yield source.close


def kafka_sink(client: Library) -> Iterator[Callable[[], object]]:
    """A sink that has sent a record."""
    client.__len__.return_value = 0
    sink: KafkaSink[int] = KafkaSink(KAFKA, 't', LOG, fits_topic=True)
    yield sink.open
    yield lambda: sink.produce(Outgoing('t', None, b'', []), 1)
    sink._may_hurry = True
    yield sink.hurry
    yield lambda: sink.poll(0.0)
    yield sink.close


def group_lock(client: Library) -> Iterator[Callable[[], object]]:
    """A lock that is held."""
    client.list_topics.return_value.topics = {'b.lock': MagicMock(error=None, partitions=[0])}
    client.poll.return_value = None
    client.assignment.return_value = []
    held = GroupLock(KAFKA, 'b', 'r', LOG)
    yield held.open
    yield lambda: call_back(client, 'on_assign')
    yield lambda: held.poll(0.0)
    held._health.away = 'away'
    yield held.check
    yield held.has_standby
    yield held.close


def end_of_topic(client: Library) -> Iterator[Callable[[], object]]:
    """The end of a topic that is empty."""
    client.list_topics.return_value.topics = {'t': MagicMock(error=None, partitions=[0])}
    client.get_watermark_offsets.return_value = (0, 0)
    yield lambda: KafkaTail(KAFKA, 't').read(10, 1.0, lambda _: None)


def ros_source(handle: Library) -> Iterator[Callable[[], object]]:
    """A source that takes from one subscription."""
    handle.get_publishers_info_by_topic.return_value = []
    subscription = handle.create_subscription.return_value.handle
    subscription.take_message.return_value = None
    source = source_of(end_of(still_node(handle, handle.context), TYPE))
    yield source.open
    yield lambda: source.take(10, 0.01)
    yield source.look
    yield source.close


def ros_sink(handle: Library) -> Iterator[Callable[[], object]]:
    """A sink that has published."""
    handle.get_subscriptions_info_by_topic.return_value = []
    event = handle.EventHandle.return_value
    event.take_event.return_value = MagicMock(current_count=1, total_count=1)
    writer = writer_of(end_of(still_node(handle, handle.context), TYPE))
    yield writer.open
    yield writer.readers
    yield lambda: writer.publish([b''])
    yield writer.raise_failure
    yield writer.readers
    yield writer.close


def ros_graph(handle: Library) -> Iterator[Callable[[], object]]:
    """A graph that tells of its changes."""
    handle.get_publishers_info_by_topic.return_value = []
    node, told, views = RosNode(handle, handle.context), threading.Event(), []

    def watch() -> None:
        views.append(node.graph.watch(partial(node.publishers, '/t'), told.set))

    yield watch
    yield lambda: views[0].peers
    handle.get_publishers_info_by_topic.return_value = [MagicMock(endpoint_gid=[7])]
    yield lambda: told.wait(2.0) or pytest.fail('a change is not told')
    yield lambda: node.graph.forget(views[0])
    yield node.graph.close


def call_back(client: Library, name: str) -> None:
    """Call what a client was given; what that raises is raised by the poll that calls it."""
    with contextlib.suppress(KafkaException):
        client.subscribe.call_args.kwargs[name](client, [HERE])


def record() -> MagicMock:
    """What a client reads."""
    message = MagicMock()
    message.error.return_value = None
    message.partition.return_value, message.offset.return_value = 0, 5
    return message


def error(code: int) -> MagicMock:
    """What a client reads in place of a record."""
    message = record()
    message.error.return_value = MagicMock()
    message.error.return_value.code.return_value = code
    return message


def of_kafka(monkeypatch: pytest.MonkeyPatch) -> Library:
    """A library whose clients are all one."""
    client = MagicMock()
    for module in (group_client, ranges):
        monkeypatch.setattr(module, 'Consumer', lambda *_, **__: client.Consumer() and client)
    monkeypatch.setattr(producer, 'Producer', lambda *_, **__: client.Producer() and client)
    monkeypatch.setattr(admin, 'AdminClient', lambda *_, **__: client.AdminClient() and client)
    return client


def of_ros(monkeypatch: pytest.MonkeyPatch) -> Library:
    """A library with one node."""
    handle = MagicMock()
    handle.rcl.rcl_subscription_set_on_new_message_callback.return_value = 0
    handle.rcl.rcl_wait_set_add_guard_condition.return_value = 0
    monkeypatch.setattr(rcl, '_rcl', lambda: handle.rcl)
    monkeypatch.setattr(_rclpy, 'GuardCondition', handle.GuardCondition)
    monkeypatch.setattr(_rclpy, 'WaitSet', handle.WaitSet)
    monkeypatch.setattr(_rclpy, 'EventHandle', handle.EventHandle)
    return handle


def live(life: Life, library: Library) -> list[Exception]:
    """Let an end live, and close where one of its calls raises; returns what was raised."""
    raised: list[Exception] = []
    last: Callable[[], object] | None = None
    for call in life(library):
        last = call
        if not raised:
            _call(call, raised)
    if raised and last is not None:
        _call(last, raised)
    return raised


def _call(call: Callable[[], object], raised: list[Exception]) -> None:
    try:
        call()
    except Exception as problem:  # noqa: BLE001 (all are looked at)
        raised.append(problem)


def let_fail(library: Library, names: Iterable[str], number: int, problem: Exception) -> None:
    """Let the call of that number fail, of all calls of these names."""
    count = itertools.count()

    def side_effect(*_: object, **__: object) -> object:
        if next(count) == number:
            raise problem
        return DEFAULT

    for name in names:
        place = name.replace('()', '.return_value')
        library.configure_mock(**{f'{place}.side_effect': side_effect})


def first_of_each(calls: list[str]) -> list[int]:
    """The numbers of the first calls of each name: while an end waits there are thousands."""
    seen: Counter[str] = Counter()
    numbers = []
    for number, name in enumerate(calls):
        seen[name] += 1
        if seen[name] <= OF_EACH:
            numbers.append(number)
    return numbers


LibraryOf = Callable[[pytest.MonkeyPatch], Library]

KINDS: dict[LibraryOf, tuple[Exception, Exception]] = {
    of_kafka: (
        KafkaException(KafkaError(KafkaError._SSL, 'no')),
        KafkaException(KafkaError(KafkaError._FATAL, 'no', fatal=True)),
    ),
    of_ros: (_rclpy.RCLError('no'), _rclpy.InvalidHandle('no')),
}
ENDS = [
    pytest.param(of_kafka, kafka_source, 13, id='kafka source'),
    pytest.param(of_kafka, kafka_sink, 7, id='kafka sink'),
    pytest.param(of_kafka, group_lock, 10, id='lock'),
    pytest.param(of_kafka, end_of_topic, 4, id='end of a topic'),
    pytest.param(of_ros, ros_source, 5, id='ros source'),
    pytest.param(of_ros, ros_graph, 8, id='ros graph'),
    pytest.param(of_ros, ros_sink, 7, id='ros sink'),
]


@pytest.mark.parametrize(('library_of', 'life', 'least'), ENDS)
@pytest.mark.parametrize('kind', [0, 1])
def test_guarantee_5_a_call_that_fails_is_an_error_of_the_bridge(
    monkeypatch: pytest.MonkeyPatch,
    library_of: LibraryOf,
    life: Life,
    least: int,
    kind: int,
) -> None:
    library = library_of(monkeypatch)
    assert live(life, library) == []
    calls = [str(call[0]) for call in library.mock_calls if '__' not in call[0]]
    assert len(set(calls)) >= least, set(calls)
    for number in first_of_each(calls):
        broken = library_of(monkeypatch)
        let_fail(broken, set(calls), number, KINDS[library_of][kind])
        for raised in live(life, broken):
            assert isinstance(raised, BridgeError), f'{calls[number]} raises {raised!r}'


def test_a_lock_that_is_open_raises_nothing_as_a_turn_is_asked_for_anywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = ['poll', 'list_topics', 'AdminClient', 'describe_consumer_groups', 'Consumer']
    calls += ['unsubscribe', 'assignment', 'close', 'subscribe']
    for name, problem in itertools.product(calls, KINDS[of_kafka]):
        client = of_kafka(monkeypatch)
        topic = MagicMock(error=None, partitions=[0])
        client.list_topics.return_value.topics = {'b.lock': topic}
        client.poll.return_value.error.return_value = None
        client.assignment.return_value = []
        held = GroupLock(KAFKA, 'b', 'r', LOG)
        held.open()
        let_fail(client, [name], 0, problem)
        held.poll(0.0)
        held.poll(0.0)
        held.has_standby()
        held.close()
        held.poll(0.0)


def test_guarantee_5_a_publisher_that_fails_is_replaced_and_its_readers_are_new(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handle = of_ros(monkeypatch)
    handle.get_subscriptions_info_by_topic.return_value = []
    event = handle.EventHandle.return_value
    event.take_event.return_value = MagicMock(current_count=2, total_count=2)
    writer = writer_of(end_of(still_node(handle, handle.context), TYPE))
    writer.open()
    assert writer.readers().come == 2
    publisher = handle.create_publisher.return_value.handle
    publisher.publish_raw.side_effect = _rclpy.RCLError('cannot publish data, at ./rcl.c:1')
    assert not writer.publish([b'']), 'a full history is no failure'
    publisher.publish_raw.side_effect = _rclpy.RCLError('publisher is invalid, at ./rcl.c:1')
    assert not writer.publish([b''])
    with pytest.raises(RouteError, match=r'^publisher of /t: publisher is invalid$'):
        writer.raise_failure()
    publisher.publish_raw.side_effect = None
    event.take_event.return_value = MagicMock(current_count=0, total_count=0)
    after = writer.readers()
    assert handle.create_publisher.call_count == 2
    assert (after.matched, after.come, after.lost) == (0, 2, True)
    event.take_event.return_value = MagicMock(current_count=1, total_count=1)
    assert writer.readers().come == 3, 'it has come anew, and has to settle'


def test_a_look_at_the_readers_that_fails_once_costs_no_history_of_a_publisher(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handle = of_ros(monkeypatch)
    handle.get_subscriptions_info_by_topic.return_value = []
    event = handle.EventHandle.return_value
    good = MagicMock(current_count=0, total_count=0)
    bad = _rclpy.RCLError('no')
    writer = writer_of(end_of(still_node(handle, handle.context), TYPE))
    writer.open()
    for looks, publishers in (([bad, good, bad, good], 1), ([bad, bad, good], 2)):
        event.take_event.side_effect = looks
        for look in looks:
            with contextlib.suppress(RouteError) if look is bad else contextlib.nullcontext():
                writer.readers()
        assert handle.create_publisher.call_count == publishers


@pytest.mark.parametrize('fails', ['its opening', 'what comes behind it'])
def test_guarantee_4_a_route_that_cannot_be_made_leaves_no_reader_behind(
    monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    source, sink = MagicMock(), MagicMock()
    failing = source.open if fails == 'its opening' else sink
    failing.side_effect = RouteError('no')
    monkeypatch.setattr(wiring_module, 'RosSource', lambda *_, **__: source)
    monkeypatch.setattr(TypeLoader, 'load', lambda *_: TYPE)
    monkeypatch.setattr(wiring_module, 'KafkaSink', sink)
    config = validated(
        Config,
        {
            'name': 'b',
            'kafka': KAFKA,
            'routes': [
                {
                    'name': 'r',
                    'from': {'ros': '/t', 'type': 'std_msgs/msg/String'},
                    'to': {'kafka': 't'},
                    'format': 'cdr',
                }
            ],
        },
    )
    abilities = Abilities(bounded=True, gid=True, seq=True, denies=True, own=b'')
    wiring = Wiring(config, MagicMock(), abilities, Histories({}, {}, None), {}, MagicMock())
    with contextlib.ExitStack() as stack:
        with pytest.raises(RouteError):
            wiring.make(config.routes[0], LOG, Stop(), stack)
        source.open.assert_called_once_with()
        source.close.assert_called_once_with()
