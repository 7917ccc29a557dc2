"""Taking by rcl itself, which tells of a message what rclpy tells of it; else by rclpy."""

import ctypes
import time
from collections.abc import Iterator
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, Final

import pytest
from rclpy.qos import QoSProfile
from support.ros.ends import end_of

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.probe import SAMPLES, Abilities, probe, probe_topic
from ros2_kafka_bridge.ros.rcl import Take
from ros2_kafka_bridge.ros.take import Taken, is_told_by_rcl, make_take, take
from ros2_kafka_bridge.ros.types import load_type

TYPE: Final = load_type('std_msgs/msg/String')
WITHIN_S: Final = 20.0
# One that is larger than what is there for each take, between two that are not.
SIZES: Final = (1, 552, 200_000, 3, 65_527, 65_528, 0)


def cdr(size: int, letter: bytes = b'x') -> bytes:
    text = letter * size
    return b'\0\1\0\0' + (size + 1).to_bytes(4, 'little') + text + b'\0'


@pytest.fixture
def ends(ros_domain: int) -> Iterator[tuple[Any, Any, Any]]:
    """A publisher, and two subscriptions of it."""
    with open_node('take', ros_domain, Histories({}, {})) as node:
        end, qos = end_of(node, TYPE, '/taken'), QoSProfile(depth=100)
        publisher = end.advertise(qos)
        one, two = end.subscribe(qos), end.subscribe(qos)
        deadline_s = time.monotonic() + WITHIN_S
        while publisher.events.look()[0] < 2 and time.monotonic() < deadline_s:
            time.sleep(0.002)
        yield publisher.handle, one, two
        end.unsubscribe(one)
        end.unsubscribe(two)
        end.withdraw(publisher)


def all_of(take_some: Take, count: int, limit: int = 100) -> list[Message]:
    taken: list[Message] = []
    deadline_s = time.monotonic() + WITHIN_S
    while len(taken) < count and time.monotonic() < deadline_s:
        taken += take_some(limit)[0]
        time.sleep(0.002)
    return taken


def test_guarantee_8_rcl_itself_tells_of_each_message_what_rclpy_tells(
    ends: tuple[Any, Any, Any],
) -> None:
    publisher, one, two = ends
    sent = [cdr(size) for size in SIZES]
    for message in sent:
        publisher.publish(message)
    by_rcl = all_of(make_take(one, has_gid=True, by_rcl=True), len(sent))
    by_rclpy = all_of(make_take(two, has_gid=True, by_rcl=False), len(sent))
    assert by_rcl == by_rclpy
    assert [type(message.cdr) for message in by_rcl] == [bytes] * len(sent)
    assert [message.cdr[: len(it)] for message, it in zip(by_rcl, sent, strict=True)] == sent
    assert [message.seq for message in by_rcl] == [*range(1, len(sent) + 1)]
    assert {len(message.gid) for message in by_rcl} == {16}


def test_no_more_are_taken_than_asked_for_and_it_tells_whether_that_was_all(
    ends: tuple[Any, Any, Any],
) -> None:
    publisher, one, two = ends
    for letter in b'abc':
        publisher.publish(cdr(5, bytes([letter])))
    assert len(all_of(make_take(two, has_gid=True, by_rcl=True), 3)) == 3, 'all are there'
    take_some = make_take(one, has_gid=True, by_rcl=True)
    (first,), none_left = take_some(1)
    assert (first.cdr[8:9], none_left) == (b'a', False)
    rest, none_left = take_some(5)
    assert ([message.cdr[8:9] for message in rest], none_left) == ([b'b', b'c'], True)
    assert take_some(5) == ([], True)


@pytest.mark.parametrize('by_rcl', [True, False])
def test_a_take_ends_with_so_many_bytes_and_says_that_something_is_left(
    ends: tuple[Any, Any, Any], *, by_rcl: bool
) -> None:
    publisher, one, two = ends
    for letter in b'abcd':
        publisher.publish(cdr(100, bytes([letter])))
    assert len(all_of(make_take(two, has_gid=True, by_rcl=True), 4)) == 4, 'all are there'
    take_some = make_take(one, 150, has_gid=True, by_rcl=by_rcl)
    first, none_left = take_some(500)
    assert ([message.cdr[8:9] for message in first], none_left) == ([b'a', b'b'], False)
    rest, _ = take_some(500)
    assert [message.cdr[8:9] for message in rest] == [b'c', b'd']
    assert take_some(500) == ([], True)


def test_rcl_is_called_only_where_it_was_seen_to_tell_the_same(
    ends: tuple[Any, Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher, one, two = ends
    for _ in range(2):
        publisher.publish(cdr(5))
    publisher.publish(cdr(6))
    assert len(all_of(make_take(two, has_gid=True, by_rcl=False), 3)) == 3, 'all are there'
    before = take(one, 1)[0][0]
    assert is_told_by_rcl(one, before)
    assert not is_told_by_rcl(one, before), 'it is another message'
    monkeypatch.setattr('ros2_kafka_bridge.ros.take._ANSWER_S', 0.1)
    assert not is_told_by_rcl(one, before), 'there is none'
    assert not is_told_by_rcl(one, (before[0], {})), 'this rclpy tells no publisher'
    unnumbered = before[0], {**before[1], 'publication_sequence_number': None}
    publisher.publish(cdr(5))
    assert not is_told_by_rcl(one, unnumbered), 'as Cyclone DDS'


def test_where_rcl_fails_rclpy_tells_why() -> None:
    nothing = ctypes.create_string_buffer(64)  # an rcl_subscription_t that was never begun

    class Handle(nullcontext[None]):
        pointer = ctypes.addressof(nothing)

    broken = SimpleNamespace(handle=Handle())
    asked: list[int] = []

    def otherwise(limit: int) -> tuple[list[Message], bool]:
        asked.append(limit)
        return [], True

    assert rcl.make_take(broken, otherwise)(7) == ([], True)
    assert asked == [7]


def test_a_middleware_may_make_room_anew_for_each_message(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Cyclone DDS does; and its buffer may come to lie elsewhere."""
    load = ctypes.PyDLL
    utils, left = load('librcutils.so'), [cdr(size) for size in (552, 200_000, 3, 70_000, 0)] * 20
    sent = [*left]

    def take_one(_: int, into: int, _info: int, _allocation: None) -> int:
        if not left:
            return 401
        message = left.pop(0)
        room = ctypes.c_size_t(len(message))
        assert not utils.rcutils_uint8_array_resize(ctypes.c_void_p(into), room)
        place_and_length = (ctypes.c_size_t * 2).from_address(into)
        ctypes.memmove(place_and_length[0], message, len(message))
        place_and_length[1] = len(message)
        return 0

    kind = ctypes.PYFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4)
    taking = SimpleNamespace(rcl_take_serialized_message=kind(take_one))
    monkeypatch.setattr(
        ctypes, 'PyDLL', lambda name: taking if name == 'librcl.so' else load(name)
    )

    class Handle(nullcontext[None]):
        pointer = 8

    take_some = rcl.make_take(SimpleNamespace(handle=Handle()), lambda _: ([], True))
    assert [message.cdr for message in all_of(take_some, len(sent), limit=7)] == sent


def probed(domain: int) -> Abilities:
    topic = probe_topic()
    ends = {topic: SAMPLES}
    with open_node('probe', domain, Histories(ends, ends)) as node:
        return probe(node, topic)


def test_the_middleware_of_these_tests_is_taken_from_by_rcl(ros_domain: int) -> None:
    abilities = probed(ros_domain)
    assert (abilities.gid, abilities.seq, abilities.by_rcl) == (True, True, True)


def test_a_middleware_that_tells_no_number_is_taken_from_by_rclpy(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unnumbered(*of: Any) -> tuple[list[Taken], bool]:
        taken, is_empty = take(*of)
        return [
            (it, {**info, 'publication_sequence_number': None}) for it, info in taken
        ], is_empty

    monkeypatch.setattr('ros2_kafka_bridge.ros.take.take', unnumbered)
    abilities = probed(ros_domain)
    assert (abilities.gid, abilities.seq, abilities.by_rcl) == (True, False, False)
