"""The types of a whole graph: who is asked for which, and for how long."""

import signal
import threading
from collections.abc import Callable
from typing import Any, cast

import msgspec
import pytest

from ros2_kafka_bridge.config.settings import QoS, RosSettings
from ros2_kafka_bridge.errors import BridgeError, RouteError
from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.message_types.description import DescribedTypes
from ros2_kafka_bridge.ros import shown_types
from ros2_kafka_bridge.ros.node import RosNode, Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile
from ros2_kafka_bridge.ros.shown_types import ShownTypes, load_all, load_shown
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader, WantedType

STRING = 'std_msgs/msg/String'
OWN, HASH, OTHER = 'acme/msg/Own', 'RIHS01_aa', 'RIHS01_bb'
Asked = list[tuple[str, str, list[str]]]


def peer(node: str, name: str = OWN, type_hash: str = HASH) -> Peer:
    return Peer.of_qos(node, name, b'1', type_hash, profile(QoS()))


def topic(name: str, *publishers: Peer) -> Topic:
    types = sorted({peer.message_type for peer in publishers})
    return Topic(name, types, list(publishers), [])


def described(name: str) -> DescribedTypes:
    """A description of that name, as a node tells it."""
    [string] = describe(STRING).types.values()
    types = {name: msgspec.structs.replace(string, type_name=name)}
    return DescribedTypes(types, {}, 'is described by the node /robot')


def loaded(
    monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], DescribedTypes], *graph: Topic
) -> tuple[ShownTypes, Asked]:
    asked: Asked = []

    def ask_users(_: Any, look: Any, name: str, wanted: str, patience_s: float) -> DescribedTypes:
        assert 0 < patience_s <= 5
        asked.append((name, wanted, [peer.node for peer in look()]))
        return answer(name)

    monkeypatch.setattr(shown_types, 'ask_users', ask_users)
    node = cast('RosNode', None)
    return load_shown(node, TypeLoader(RosSettings()), graph), asked


def test_each_definition_is_asked_for_once_and_of_all_who_are_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bridge = peer('/kafka_bridge_b')
    graph = [topic('/a', peer('/r1'), bridge), topic('/b', peer('/r2')), topic('/c', peer('/r3'))]
    graph[2] = topic('/c', peer('/r3', STRING))
    found, asked = loaded(monkeypatch, described, *graph)
    assert asked == [(OWN, HASH, ['/r1', '/r2', '/r3'])], 'bridges describe none'
    assert found.keys() == {('/a', OWN), ('/b', OWN)}, 'what is installed is not asked for'
    for one in found.values():
        assert isinstance(one, MessageType)
        assert (one.name, one.origin) == (OWN, 'is described by the node /robot')


def test_two_definitions_on_one_topic_are_told_and_ask_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mixed = topic('/a', peer('/r1'), peer('/r2', OWN, OTHER))
    found, asked = loaded(monkeypatch, described, mixed, topic('/b', peer('/r2', OWN, OTHER)))
    assert 'nodes define it in 2 ways' in str(found['/a', OWN])
    assert asked == [(OWN, OTHER, ['/r1', '/r2', '/r2'])]
    assert isinstance(found['/b', OWN], MessageType)


def test_those_without_an_answer_are_waited_for_side_by_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = threading.Barrier(8, timeout=20)

    def silent(_: str) -> DescribedTypes:
        together.wait()
        raise RouteError('nobody describes it')

    graph = [topic(f'/t{n}', peer('/robot', f'acme/msg/T{n}')) for n in range(8)]
    found, _ = loaded(monkeypatch, silent, *graph)
    assert len(found) == 8
    assert all(str(one).endswith('nobody describes it') for one in found.values())


def test_when_the_time_is_over_nobody_else_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shown_types, '_ALL_S', 0.0)
    found, asked = loaded(monkeypatch, described, topic('/a', peer('/r')))
    assert isinstance(found['/a', OWN], BridgeError)
    assert 'no time was left to ask for it' in str(found['/a', OWN])
    assert asked == []


def test_ctrl_c_waits_for_no_answer() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    over, answered = threading.Event(), threading.Event()

    def ask(*_: str) -> DescribedTypes:
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signal.SIGINT)
        over.wait(20)
        answered.set()
        raise RouteError('nobody describes it')

    loader = TypeLoader(RosSettings(), patience_s=1000)
    try:
        with pytest.raises(KeyboardInterrupt):
            load_all(loader, [WantedType(OWN, {HASH: '/robot'}, ask)])
        assert not answered.is_set()
    finally:
        over.set()
        signal.signal(signal.SIGINT, before)
