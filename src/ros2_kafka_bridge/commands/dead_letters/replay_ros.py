"""Publishing dead letters straight to ROS, the way of every record, until all readers have them.

A letter is checked, decoded, published and confirmed as its record would be. It only comes from
where letters are, and counts as sent once it is marked.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial
from itertools import islice, starmap
from typing import Final, NamedTuple

from ros2_kafka_bridge.commands.screen import waiting
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, Rebalance, Record, RecordSource
from ros2_kafka_bridge.errors import RouteError, TransportError
from ros2_kafka_bridge.kafka_to_ros import KafkaToRos
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.ros.message_sizes import described_sizes, histories_of
from ros2_kafka_bridge.ros.node import RosNode, open_node
from ros2_kafka_bridge.ros.probe import probe, probe_topic
from ros2_kafka_bridge.threads.stop import Part, Stop
from ros2_kafka_bridge.tracing.routes import Tracing
from ros2_kafka_bridge.wiring import Wiring

_PATIENCE_S: Final = 30.0

MakePipeline = Callable[[KafkaToRosRoute, RecordSource], KafkaToRos]
"""Route, where its records come from -> what carries them."""


class Channels(NamedTuple):
    """The way to ROS.

    Args:
        node: Where they are.
        open: Opens the channel of a route, once.
    """

    node: RosNode
    open: Callable[[KafkaToRosRoute], 'LetterChannel']


@contextmanager
def open_channels(config: Config, stop: Stop) -> Iterator[Channels]:
    """Join ROS; the channel of a route is opened when its first letter comes.

    Args:
        config: With the routes.
        stop: Ends the waiting.
    """
    # Whatever the routes do: what a reader has not acknowledged would be marked as sent.
    config = replace(config, ros=replace(config.ros, confirmation='acknowledged'))
    probed = probe_topic()
    sizes = described_sizes(config)
    histories = histories_of(config.routes, sizes, probed, config.ros.lease_s)
    name = f'{config.name}_replay'
    with open_node(name, config.ros.domain_id, histories) as node, ExitStack() as stack:
        wiring = Wiring(config, node, probe(node, probed), histories, sizes, Tracing())

        @cache
        def channel(route: KafkaToRosRoute) -> LetterChannel:
            return LetterChannel(route, partial(_make, wiring, stop, stack), stop)

        yield Channels(node, channel)


def _make(
    wiring: Wiring, stop: Stop, stack: ExitStack, route: KafkaToRosRoute, source: RecordSource
) -> KafkaToRos:
    try:
        pipeline = wiring.to_ros(route, source, route_log(route.name), stop, stack)
    except RouteError as error:
        raise RouteError(f'{error}; without --to ros letters go to their topic') from error
    if pipeline is None:
        raise TransportError(f'stopped before {route.ros_topic} was open')
    return pipeline


class LetterChannel:
    """The route of letters, and what it has delivered.

    Args:
        route: Whose letters they are.
        make: Makes what carries the records of a source along a route.
        stop: Ends the waiting.
    """

    def __init__(self, route: KafkaToRosRoute, make: MakePipeline, stop: Stop) -> None:
        self._route = _for_letters(route)
        self._letters = LetterSource()
        self._pipeline = make(self._route, self._letters)
        self._stop = stop
        self._published = 0  # of the letters given last, and not confirmed

    @property
    def delivered(self) -> int:
        """How many of the letters given last every reader has acknowledged, the first of them.

        None where some were published to readers of which nothing tells what they have.
        """
        return 0 if self._published else self._letters.ended

    def deliver(self, letters: Sequence[Outgoing]) -> None:
        """Publish letters in order, and wait until every reader has acknowledged all of them.

        A first stop lets it publish no more: `delivered` tells how far it got.

        Raises:
            TransportError: There are too few readers, one does not acknowledge, or a stop left no
                time to wait for that; `delivered` tells as well.
            RouteError: ROS refuses them; the same.
        """
        topic, needed = self._route.ros_topic, self._route.min_subscribers
        before = self._pipeline.snapshot.published
        self._letters.hold(letters)
        with waiting(f'Waiting for the subscribers of {topic}'):
            patience = _Patience(self._stop, self._letters, self._pipeline)
            self._pipeline.run(patience)
        measures = self._pipeline.snapshot.measures
        self._published = self._pipeline.snapshot.published - before
        if self._published:
            raise TransportError(
                f'{topic} has no reliable subscriber: nothing tells what the others have received'
            )
        if not self._letters.lag() or (self._stop.asked and not measures.queued):
            return
        if self._stop.asked:
            raise TransportError(f'stopped while waiting for the subscribers of {topic}')
        if (matched := measures.matched or 0) < needed:
            there = f'{matched} of {count(needed, "subscriber")}'
            raise TransportError(f'{there} of {topic} there after {_PATIENCE_S:g} s')
        if patience.reason and not measures.queued:  # none was published that is not acknowledged
            raise TransportError(f'{topic}: {patience.reason}')
        raise TransportError(f'a subscriber of {topic} does not take: not acknowledged')


def _for_letters(route: KafkaToRosRoute) -> KafkaToRosRoute:
    """A route as letters take it: whatever it offers, an acknowledgement is waited for."""
    qos = replace(route.qos, reliability='reliable', history='keep_all', depth=None)
    return replace(
        route,
        sink=replace(route.sink, qos=qos),
        min_subscribers=max(1, route.min_subscribers),
        when_full='wait',
        on_error='stop',  # it was checked before, and is a dead letter already
        drain_s=_PATIENCE_S,
    )


class _Patience(Part):
    """Ends a run once all letters have ended, and at once where nothing has moved for long."""

    def __init__(self, stop: Stop, letters: 'LetterSource', pipeline: KafkaToRos) -> None:
        super().__init__(stop)
        self._letters = letters
        self._pipeline = pipeline
        self.reason = ''  # for which it waited last
        self._seen: tuple[int, int, int | None] = (0, 0, 0)
        self._until_s = time.monotonic() + _PATIENCE_S

    @property
    def asked(self) -> bool:
        """Whether to drain; the run asks in each round."""
        self._look()
        return super().asked

    @property
    def at_once(self) -> bool:
        """Whether to give up what is still in flight; a drain asks in each round."""
        self._look()
        return super().at_once

    def _look(self) -> None:
        """Look at what has moved."""
        now_s, told = time.monotonic(), self._pipeline.snapshot
        self.reason = told.reason or self.reason
        seen = told.carried, told.repeated, told.measures.queued
        if seen != self._seen:
            self._seen, self._until_s = seen, now_s + _PATIENCE_S
        self._now = now_s >= self._until_s
        self._drain = self._now or not self._letters.lag()


class LetterSource:
    """A `RecordSource` of letters that were chosen: it notes how many of them have ended."""

    away = held_back = ''
    reached = answers = True  # the letters have been read
    lost_upstream = rebalances = 0

    def __init__(self) -> None:
        self.ended = self._held = 0
        self._waiting: Iterator[Record] = iter(())

    def hold(self, letters: Sequence[Outgoing]) -> None:
        """Hand these out next, and count from them."""
        self.ended, self._held = 0, len(letters)
        self._waiting = starmap(_LetterRecord, enumerate(letters))

    def open(self, rebalance: Rebalance) -> None:
        """Nobody takes them away."""

    def poll(self, limit: int, timeout_s: float) -> Sequence[Record]:
        """Hand out what waits."""
        found = list(islice(self._waiting, limit))
        if not found:
            time.sleep(timeout_s)
        return found

    def stay(self) -> Sequence[Record]:
        """There is no group."""
        return ()

    def advance(self, positions: Mapping[int, int]) -> None:
        """Note how many have ended."""
        self.ended = max(self.ended, *positions.values())

    def commit(self) -> None:
        """Who has sent them marks them, all that have ended at once."""

    def commit_now(self, timeout_s: float) -> bool:
        """The same."""
        del timeout_s
        return True

    def lag(self) -> int:
        """How many have not ended."""
        return self._held - self.ended

    def close(self) -> None:
        """There is no group."""


class _LetterRecord(NamedTuple):
    """A letter as the record that it was, at its place among those chosen."""

    number: int
    was: Outgoing

    def partition(self) -> int:
        return 0

    def offset(self) -> int:
        return self.number

    def key(self) -> bytes | None:
        return self.was.key

    def value(self) -> bytes | None:
        return self.was.value

    def headers(self) -> HeaderList:
        return self.was.headers

    def timestamp(self) -> tuple[int, int]:
        return 0, 0  # unknown: whoever replays a letter finds it young enough (`max_age_s`)
