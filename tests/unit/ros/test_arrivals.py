"""Waiting for messages: who rings is named, and who does not ring is looked at all the same."""

import gc
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rclpy.qos import QoSProfile
from support.ros.ends import end_of

from ros2_kafka_bridge.ros import rcl
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.take import take
from ros2_kafka_bridge.ros.types import load_type
from ros2_kafka_bridge.threads.wakeup import Wakeup

TYPE = load_type('builtin_interfaces/msg/Time')
CDR = b'\x00\x01\x00\x00' + bytes(8)
LONG_S = 20.0
Answer = Callable[..., bool]


def refuses(*_: object) -> bool:
    return False


def obeys(*_: object) -> bool:
    return True


def breaks(*_: object) -> bool:
    raise RuntimeError('the subscription is of no use')


@contextmanager
def soon(act: Callable[[], object]) -> Iterator[None]:
    """Let something happen while the test waits, which takes nothing like the longest time."""
    timer = threading.Timer(0.1, act)
    began_s = time.monotonic()
    timer.start()
    yield
    assert 0.05 < time.monotonic() - began_s < LONG_S / 2
    timer.join()


def test_only_the_topics_that_rang_are_named() -> None:
    arrivals = Arrivals(Wakeup())
    notifiers = {topic: arrivals.of(topic) for topic in ('/a', '/b', '/c')}
    for topic in ('/c', '/a', '/a'):
        notifiers[topic].wakeup.ring()
    assert sorted(arrivals.wait(LONG_S)) == ['/a', '/c']
    assert arrivals.wait(0.0) == [], 'each is named once'


def test_a_ring_ends_a_wait() -> None:
    arrivals = Arrivals(Wakeup())
    arrivals.of('/a')
    with soon(arrivals.of('/b').wakeup.ring):
        assert arrivals.wait(LONG_S) == ['/b']


def test_whoever_else_ends_a_wait_ends_one_and_names_no_topic() -> None:
    wakeup = Wakeup()
    arrivals = Arrivals(wakeup)
    arrivals.of('/a')
    with soon(wakeup.ring):
        assert arrivals.wait(LONG_S) == []
    assert not wakeup.is_rung
    with soon(wakeup.ring):
        assert arrivals.wait(LONG_S) == []


def test_what_rings_between_the_wait_and_the_take_is_named_the_next_time() -> None:
    arrivals = Arrivals(Wakeup())
    notifier = arrivals.of('/a')
    notifier.wakeup.ring()
    assert arrivals.wait(LONG_S) == ['/a']
    notifier.wakeup.ring()
    assert arrivals.wait(LONG_S) == ['/a']


@pytest.mark.parametrize('answer', [refuses, breaks])
def test_where_a_middleware_does_not_tell_no_wait_is_longer_than_a_moment(
    monkeypatch: pytest.MonkeyPatch, answer: Answer
) -> None:
    arrivals = Arrivals(Wakeup())
    told, untold = arrivals.of('/told'), arrivals.of('/untold')
    monkeypatch.setattr(rcl, 'notify', obeys)
    told.attach(object())
    with soon(told.wakeup.ring):
        assert arrivals.wait(LONG_S) == ['/told'], 'all tell'
    monkeypatch.setattr(rcl, 'notify', answer)
    untold.attach(object())
    monkeypatch.setattr(rcl, 'notify', obeys)
    untold.attach(object())  # the other subscription is there still
    took_s = []
    for _ in range(5):
        began_s = time.monotonic()
        assert arrivals.wait(1.0) == []
        took_s.append(time.monotonic() - began_s)
    assert 0.008 < min(took_s) < 0.05


@pytest.mark.parametrize(
    ('attached', 'detached', 'stays'),
    [
        (obeys, obeys, False),
        (obeys, refuses, True),
        (obeys, breaks, True),
        (refuses, refuses, False),
        (breaks, breaks, False),
    ],
)
def test_a_descriptor_stays_open_only_where_somebody_may_write_to_it_for_ever(
    monkeypatch: pytest.MonkeyPatch, attached: Answer, detached: Answer, *, stays: bool
) -> None:
    monkeypatch.setattr(rcl, 'notify', attached)
    monkeypatch.setattr(rcl, 'notify_nobody', detached)
    notifier = Arrivals(Wakeup()).of('/t')
    descriptor = notifier.wakeup.descriptor
    notifier.attach(object())
    notifier.detach(object())
    del notifier
    gc.collect()
    assert is_open(descriptor) == stays
    if stays:
        os.close(descriptor)


def is_open(descriptor: int) -> bool:
    """Whether it is that of an eventfd."""
    try:
        return 'eventfd' in str(Path(f'/proc/self/fd/{descriptor}').readlink())
    except FileNotFoundError:
        return False


@pytest.fixture
def topic(ros_domain: int) -> Iterator[tuple[Any, Callable[[], Any]]]:
    """A real one: its publisher, and what makes a subscription of it."""
    with open_node('arrivals', ros_domain, Histories({}, {})) as node:
        end, qos = end_of(node, TYPE, '/real'), QoSProfile(depth=10)
        publisher = end.advertise(qos)

        def subscribe() -> Any:
            before = publisher.events.look()[0]
            made = end.subscribe(qos)
            while publisher.events.look()[0] == before:
                time.sleep(0.002)
            return made

        yield publisher.handle, subscribe
        end.withdraw(publisher)


def test_dds_itself_rings_for_what_comes_and_for_what_is_there(
    topic: tuple[Any, Callable[[], Any]],
) -> None:
    publisher, subscribe = topic
    arrivals, subscription = Arrivals(Wakeup()), subscribe()
    publisher.publish(CDR)
    deadline_s = time.monotonic() + LONG_S
    while not (taken := take(subscription, 1)[0]) and time.monotonic() < deadline_s:
        time.sleep(0.002)
    publisher.publish(CDR)
    time.sleep(0.1)
    arrivals.of('/silent').attach(subscribe())
    notifier = arrivals.of('/real')
    notifier.attach(subscription)
    assert arrivals.wait(LONG_S) == ['/real'], 'it was there'
    assert len(taken + take(subscription, 5)[0]) == 2
    notifier.detach(subscription)
    publisher.publish(CDR)
    assert arrivals.wait(LONG_S) == ['/silent'], 'it has come'
    time.sleep(0.1)
    assert arrivals.wait(0.0) == [], 'the other rings no more'
