"""Who is at the topics of the routes: looked at once for all, as the graph has changed."""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial

import pytest
from rclpy.qos import QoSProfile
from support.ros.ends import end_of, still_graph

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros import graph as graph_module
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.graph import Changes, Graph, View
from ros2_kafka_bridge.ros.node import open_node
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.types import load_type

TYPE = load_type('builtin_interfaces/msg/Time')
SOON_S = 10.0


def peer(number: int, durability: str = 'volatile') -> Peer:
    return Peer(f'/n{number}', 'p/msg/T', bytes([number] * 16), '', 'reliable', durability, None)


class Topic:
    """Who is at it, whether that can be asked, and what a route was told of it."""

    def __init__(self, *peers: Peer) -> None:
        self.peers = [*peers]
        self.problem: Exception | None = None
        self.asked = 0
        self.told = threading.Semaphore(0)
        self.tells = 0

    def ask(self) -> list[Peer]:
        self.asked += 1
        if self.problem is not None:
            raise self.problem
        return list(self.peers)

    def tell(self) -> None:
        self.tells += 1
        self.told.release()

    def watched(self, graph: Graph) -> View:
        return graph.watch(self.ask, self.tell)


class Told:
    """Changes that a test tells of."""

    def __init__(self) -> None:
        self._news = threading.Semaphore(0)
        self.problem: Exception | None = None
        self.end_problem: Exception | None = None
        self.wait = self._wait

    def tell(self) -> None:
        self._news.release()

    def _wait(self, timeout_s: float) -> bool:
        has_changed = self._news.acquire(timeout=timeout_s)
        if self.problem is not None:
            raise self.problem
        return has_changed

    def end(self) -> None:
        if self.end_problem is not None:
            raise self.end_problem
        self.tell()


@pytest.fixture
def changes() -> Told:
    return Told()


@pytest.fixture
def graph(changes: Told) -> Iterator[Graph]:
    with closing(Graph(lambda: changes)) as made:
        yield made


def test_who_watches_sees_at_once_who_is_there(graph: Graph) -> None:
    topic = Topic(peer(1), peer(2))
    assert [*topic.watched(graph).peers] == [peer(1), peer(2)]
    assert topic.tells == 0, 'who asks is not told'


@pytest.mark.parametrize(
    ('before', 'after', 'is_told'),
    [
        ([], [peer(1)], True),
        ([peer(1), peer(2)], [peer(1)], True),
        ([peer(1)], [peer(2)], True),
        ([peer(1)], [peer(1, 'transient_local')], True),
        ([peer(1), peer(2)], [peer(2), peer(1)], False),
        ([peer(1)], [peer(1)], False),
        ([], [], False),
    ],
)
def test_only_those_routes_are_told_whose_topic_shows_another_picture(
    before: list[Peer], after: list[Peer], *, is_told: bool
) -> None:
    graph = still_graph()
    topic, other = Topic(*before), Topic(peer(9))
    view, beside = topic.watched(graph), other.watched(graph)
    view.read(), beside.read()
    topic.peers = after
    graph.look()
    graph.look()
    assert (topic.tells, other.tells) == (is_told, 0)
    assert (view.has_news, beside.has_news) == (is_told, False)
    assert {*view.peers} == {*after}
    topic.peers = [*after, peer(5)]
    assert view.look(), 'who asks by itself is told by the answer'
    graph.look()
    assert topic.tells == is_told


def test_a_change_is_seen_and_told_by_another_thread(changes: Told, graph: Graph) -> None:
    topic, other = Topic(), Topic()
    view = topic.watched(graph)
    other.watched(graph)
    topic.peers = [peer(1)]
    time.sleep(0.1)
    assert topic.asked == 1, 'nobody has said that anything changes'
    changes.tell()
    assert topic.told.acquire(timeout=SOON_S)
    assert [*view.peers] == [peer(1)]
    assert other.tells == 0


def test_an_error_of_the_graph_is_raised_to_its_users_until_the_next_good_look() -> None:
    graph = still_graph()
    topic, other = Topic(peer(1)), Topic(peer(2))
    view, beside = topic.watched(graph), other.watched(graph)
    topic.problem = RouteError('no graph')
    graph.look()
    assert topic.tells == 1
    for _ in range(2):
        with pytest.raises(RouteError, match='no graph'):
            _ = view.peers
    assert [*beside.peers] == [peer(2)]
    topic.problem = None
    graph.look()
    assert (topic.tells, [*view.peers]) == (2, [peer(1)]), 'the same as before is news now'
    topic.problem = RouteError('again')
    with pytest.raises(RouteError, match='again'):
        _ = topic.watched(graph).peers


def test_what_could_not_be_told_is_asked_for_again_without_a_change(
    monkeypatch: pytest.MonkeyPatch, graph: Graph
) -> None:
    """A route that has failed for it is tried again soon, and the graph may never change."""
    monkeypatch.setattr(graph_module, '_TURN_S', 0.01)
    topic = Topic(peer(1))
    topic.problem = RouteError('no')
    view = topic.watched(graph)
    assert view.has_failed
    topic.problem = None
    until_s = time.monotonic() + SOON_S
    while view.has_failed and time.monotonic() < until_s:
        time.sleep(0.01)
    assert [*view.peers] == [peer(1)]


def test_a_late_answer_never_takes_the_place_of_a_newer_one() -> None:
    began, goes_on = threading.Event(), threading.Event()
    answers = [[peer(1)], [peer(2)]]

    def ask() -> list[Peer]:
        answer = answers.pop(0)
        if answer == [peer(1)]:
            began.set()
            goes_on.wait(SOON_S)
        return answer

    view = View(ask, lambda: None)
    late, newer = threading.Thread(target=view.look), threading.Thread(target=view.look)
    late.start()
    assert began.wait(SOON_S)
    newer.start()
    newer.join(0.1)
    goes_on.set()
    late.join()
    newer.join()
    assert [*view.peers] == [peer(2)]


def test_what_is_forgotten_is_not_asked_for_any_more() -> None:
    graph = still_graph()
    gone, stays = Topic(), Topic()
    view = gone.watched(graph)
    stays.watched(graph)
    graph.forget(view)
    graph.forget(view)
    gone.peers = [peer(1)]
    graph.look()
    assert (gone.asked, gone.tells, stays.asked) == (1, 0, 2)


def _same(changes: Told | None) -> Told | None:
    return changes


def test_close_ends_the_thread_at_once_and_whatever_it_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(graph_module, '_UNTOLD_S', SOON_S)
    waiting, resting, untold = Told(), Told(), None
    monkeypatch.setattr(graph_module, '_REST_S', SOON_S)
    for made in (waiting, resting, untold):
        topic = Topic()
        graph = Graph(partial(_same, made))
        topic.watched(graph)
        if made is resting:
            topic.peers = [peer(1)]
            resting.tell()
            assert topic.told.acquire(timeout=SOON_S)
        began_s = time.monotonic()
        graph.close()
        assert time.monotonic() - began_s < SOON_S / 5
        assert graph._thread is not None
        assert not graph._thread.is_alive()
    Graph(lambda: None).close()  # which nobody has ever watched


def test_close_does_not_wait_long_for_a_wait_that_cannot_be_ended(
    changes: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph_module, '_END_S', 0.1)
    graph = Graph(lambda: changes)
    Topic().watched(graph)
    changes.end_problem = RuntimeError('invalid')
    began_s = time.monotonic()
    graph.close()
    assert time.monotonic() - began_s < SOON_S / 2
    changes.tell()


def test_many_topics_take_no_more_than_a_tenth_of_the_time(graph: Graph, changes: Told) -> None:
    began_s, each_s = [], 0.002

    def ask() -> list[Peer]:
        began_s.append(time.monotonic())
        time.sleep(each_s)
        return []

    for _ in range(10):
        graph.watch(ask, lambda: None)
    began_s.clear()
    for _ in range(50):
        changes.tell()  # without an end
    time.sleep(1.0)
    looks = len(began_s) / 10
    assert 1 <= looks <= 1.0 / (10 * 10 * each_s) + 1


def test_a_burst_of_changes_is_looked_at_a_few_times(graph: Graph, changes: Told) -> None:
    topic = Topic()
    topic.watched(graph)
    for _ in range(200):
        changes.tell()
        time.sleep(0.001)
    assert 2 <= topic.asked <= 0.4 / graph_module._REST_S
    topic.peers = [peer(1)]
    changes.tell()
    assert topic.told.acquire(timeout=SOON_S), 'the last of them, too'


def no_changes() -> Changes:
    raise RuntimeError('invalid')


@pytest.mark.parametrize('fails', ['its making', 'its wait', 'it is not there'])
def test_where_nothing_tells_of_changes_the_graph_is_asked_again_and_again(
    changes: Told, caplog: pytest.LogCaptureFixture, fails: str
) -> None:
    makes: dict[str, Callable[[], Changes | None]] = {
        'its making': no_changes, 'its wait': lambda: changes, 'it is not there': lambda: None,
    }  # fmt: skip
    changes.problem = RuntimeError('invalid')
    topic = Topic()
    with closing(Graph(makes[fails])) as graph:
        topic.watched(graph)
        changes.tell()
        for number in range(3):
            topic.peers.append(peer(number))
            assert topic.told.acquire(timeout=SOON_S)
        assert topic.asked < 50, 'it has a rest'
    said = [one for one in caplog.records if one.levelno == logging.WARNING]
    expected = 'ROS tells of no changes of its graph (invalid): asks each 0.1 s'
    assert [one.message for one in said] == [expected] * (fails != 'it is not there')
    assert not any(one.exc_info for one in said), "no traceback for a stranger's mistake"


def test_rcl_tells_of_a_publisher_that_comes_and_goes_and_else_of_nothing(ros_domain: int) -> None:
    histories = Histories({}, {})
    with (
        open_node('watches', ros_domain, histories) as node,
        open_node('comes', ros_domain, histories) as other,
    ):
        topic, ask = Topic(), partial(node.publishers, '/real')
        view = node.graph.watch(lambda: topic.ask() + ask(), topic.tell)
        end = end_of(other, TYPE, '/real')

        def wait_for(names: list[str]) -> None:
            while [one.node for one in view.peers] != names:
                assert topic.told.acquire(timeout=SOON_S)

        publisher = end.advertise(QoSProfile(depth=1))
        wait_for(['/kafka_bridge_comes'])
        time.sleep(0.5)
        asked = topic.asked
        time.sleep(1.0)
        assert topic.asked == asked, 'nothing has changed'
        end.withdraw(publisher)
        wait_for([])
        time.sleep(0.5)  # it waits again
        began_s = time.monotonic()
        node.graph.close()
        assert time.monotonic() - began_s < graph_module._END_S / 2, 'it waits no more'
