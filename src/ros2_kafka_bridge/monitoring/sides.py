"""What is seen of both sides, by threads of their own: who asks never waits for Kafka or ROS."""

import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Any, Final, Self

from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview, records
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.monitoring import graph
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, domain_in_words, open_node

_OFTEN_S: Final = 3.0
_SELDOM_S: Final = 15.0
_WANTED_S: Final = 20.0
_AGAIN_S: Final = 10.0
_CLOSING_S: Final = 2.0

Json = dict[str, Any]


class Sides:
    """Kafka and the ROS graph, looked at again and again while `with` lasts.

    A look at a broker that is away may outlast that by seconds.

    Args:
        watch: Knows the configuration.
        failed: Told when a thread has met a bug.
    """

    def __init__(self, watch: Watch, failed: Callable[[], None]) -> None:
        self._watch = watch
        self._failed = failed
        self._ended = threading.Event()
        self._wanted = {'kafka': _Wanted(), 'ros': _Wanted()}
        self._broker: Json | None = None
        self._letters: list[Json] = []
        self._graph: Json | None = None
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        for name, work in (('kafka', self._watch_kafka), ('ros', self._watch_ros)):
            thread = threading.Thread(target=self._run, args=(work,), name=name, daemon=True)
            thread.start()
            self._threads.append(thread)
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for wanted in self._wanted.values():
            wanted.end()
        deadline_s = time.monotonic() + _CLOSING_S
        for thread in self._threads:
            thread.join(max(0.0, deadline_s - time.monotonic()))

    def sections(self) -> Json:
        """Kafka, for the page."""
        self._wanted['kafka'].note()
        return {'broker': self._broker, 'letters': self._letters}

    def graph(self) -> Json:
        """The ROS graph as it was seen last; `seen_s` is None before that."""
        self._wanted['ros'].note()
        domain = domain_in_words(self._watch.config.ros.domain_id)
        return self._graph or {'problem': '', 'domain': domain, 'seen_s': None, 'topics': []}

    def look_again(self) -> None:
        """Look at Kafka at once: something has been changed there."""
        self._wanted['kafka'].note(at_once=True)

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException:
            self._failed()
            raise

    # Kafka

    def _watch_kafka(self) -> None:
        known: tuple[Config, Overview] | None = None
        while not self._ended.is_set():
            config = self._watch.config
            try:
                if known is None or known[0] is not config:
                    properties = common_properties(config.kafka, client_id=f'{config.name}-page')
                    known = config, Overview(properties)
                self._look_at_kafka(known[1])
            except BridgeError as error:
                known = None  # a new client tells the cause as it is then
                self._note_away(str(error))
            self._wanted['kafka'].wait(_OFTEN_S, _SELDOM_S)

    def _note_away(self, problem: str) -> None:
        """Note that Kafka does not answer: of its brokers stays what it told last."""
        before = self._broker or {}
        self._broker = {**before, 'problem': problem, 'seen_s': before.get('seen_s')}
        nothing = {'there': None, 'held': None, 'problem': problem}
        self._letters = [
            {'topic': name, 'routes': users, **nothing}
            for name, users in _letters_of(self._watch.routes).items()
        ]

    def _look_at_kafka(self, overview: Overview) -> None:
        routes = self._watch.routes
        joined = {route.kafka_topic for route in routes}
        by_topic = _letters_of(routes)
        state = overview.look({*joined, *by_topic})
        seen = {topic.name: topic for topic in state.topics}
        letters = [KafkaTopic(n, found, '') for n in by_topic if (found := seen[n].partitions)]
        begins, ends = overview.begins(letters), overview.ends(letters)
        held = {topic.name: records(topic, begins, ends) for topic in letters}
        self._letters = [
            {
                'topic': name,
                'routes': users,
                'there': seen[name].is_there,
                'held': held.get(name),
                'problem': seen[name].problem,
            }
            for name, users in by_topic.items()
        ]
        self._broker = {
            'problem': '',
            'seen_s': int(time.time()),
            'cluster_id': state.cluster_id,
            'brokers': [{'id': n, 'address': at} for n, at in state.brokers.items()],
            'controller': state.controller,
            'round_trip_s': round(state.round_trip_s, 4),
            'topics': [topic._asdict() for topic in state.topics if topic.name in joined],
        }

    # ROS

    def _watch_ros(self) -> None:
        while not self._ended.is_set():
            config = self._watch.config
            histories = Histories({}, {}, config.ros.lease_s)
            try:
                with ExitStack() as stack:
                    opened = open_node(f'{config.name}-page', config.ros.domain_id, histories)
                    self._look_at_ros(stack.enter_context(opened), config)
            except BridgeError as error:
                domain = domain_in_words(config.ros.domain_id)
                told = {'domain': domain, 'topics': [], 'seen_s': int(time.time())}
                self._graph = {**told, 'problem': str(error)}
                self._ended.wait(_AGAIN_S)

    def _look_at_ros(self, node: RosNode, began_with: Config) -> None:
        """Look until the ROS side of the configuration has changed."""
        while not self._ended.is_set():
            config, routes = self._watch.config, self._watch.routes
            if (config.name, config.ros) != (began_with.name, began_with.ros):
                return
            self._graph = {
                **graph.seen(config, routes, node.topics()),
                'seen_s': int(time.time()),
            }
            self._wanted['ros'].wait(_OFTEN_S, _SELDOM_S)


def _letters_of(routes: Iterable[AnyRoute]) -> dict[str, list[str]]:
    """The dead-letter topics of routes, with the names of those that use them."""
    found: dict[str, list[str]] = {}
    for route in routes:
        found.setdefault(route.dead_letter_topic, []).append(route.name)
    return found


class _Wanted:
    """Whether somebody has asked lately, and a pause that ends when somebody asks."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._asked_s = -_WANTED_S
        self._ended = False
        self._at_once = False

    def note(self, *, at_once: bool = False) -> None:
        with self._changed:
            self._asked_s = time.monotonic()
            self._at_once = self._at_once or at_once
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def wait(self, often_s: float, seldom_s: float) -> None:
        """Wait `often_s` while somebody asks, else `seldom_s`."""
        began_s = time.monotonic()
        with self._changed:
            while not self._ended and not self._at_once:
                now_s = time.monotonic()
                is_asked = now_s - self._asked_s < _WANTED_S
                left_s = began_s + (often_s if is_asked else seldom_s) - now_s
                if left_s <= 0:
                    break
                self._changed.wait(left_s)
            self._at_once = False
