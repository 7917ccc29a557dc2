"""What the nodes share: hearing and saying the topics of `ros2_kafka_warehouse.topics`.

A module does its work when something has come, never by a clock of its own: what comes together is
taken together, and of a latched topic only the newest counts.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, Generic, NamedTuple, TypeVar

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from ros2_kafka_warehouse.codec import MessageError, decode, encode
from ros2_kafka_warehouse.domain.site import Site, read_site
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.topics import TOPICS, Topic

M = TypeVar('M', bound=Message)

# With a depth of 1 a writer of Fast DDS 3.2 has fallen silent for good, to all its readers, after
# some of these had been killed and started again (tried: 6 of 9 runs; with 10 in none of 4).
_KEPT: Final = 10
_MOST_WAITING: Final = 1000
_FULL_S: Final = 0.02
_COMPLAIN_S: Final = 5.0
_SETTLE_S: Final = 0.7


class Settings(NamedTuple):
    """What a module is started with.

    Attributes:
        site: The site file.
        profiles: The file of the execution profiles.
        failure_profile: The file of the robot failure profile.
        bootstrap_servers: Of the Kafka that two modules remember by; '' is none.
        seed: Of the faults that the simulated robots show by chance.
        failures_per_hour: How many of these, in all robots together.
        faults: Those that they show for sure, each as `ROBOT:CODE@STEP`.
        alive: A file that is touched as long as the module works off what comes.
    """

    site: Path
    profiles: Path
    failure_profile: Path
    bootstrap_servers: str = ''
    seed: int = 0
    failures_per_hour: float = 0.0
    alive: Path | None = None
    faults: tuple[str, ...] = ()


class Newest(Generic[M]):
    """The newest message of a topic."""

    def __init__(self) -> None:
        self.or_none: M | None = None

    @property
    def value(self) -> M:
        """The message; there must be one."""
        assert self.or_none is not None, 'nothing has come yet'
        return self.or_none


class Queue(Generic[M]):
    """The messages of a topic, in order, until they are taken."""

    def __init__(self) -> None:
        self._waiting: deque[M] = deque(maxlen=_MOST_WAITING)
        self.or_none: M | None = None  # the newest, taken or not

    def add(self, message: M) -> None:
        """Let one wait."""
        self._waiting.append(message)
        self.or_none = message

    def take(self) -> list[M]:
        """All that wait; they wait no longer."""
        taken = list(self._waiting)
        self._waiting.clear()
        return taken


class Speaker:
    """Says the messages of a topic; a snapshot only when it has changed."""

    def __init__(self, publisher: Any, log: logging.Logger, *, is_snapshot: bool) -> None:
        self._publisher = publisher
        self._log = log
        self._is_snapshot = is_snapshot
        self.said: Message | None = None  # the newest snapshot

    def say(self, message: Message) -> None:
        """Publish; waits while a reader takes no more, which holds this module back, too."""
        if self._is_snapshot:
            if message is self.said or message == self.said:
                return
            self.said = message
        text = String(data=encode(message))
        complain_at_s = time.monotonic() + _COMPLAIN_S
        while not self._publish(text):
            if time.monotonic() > complain_at_s:
                complain_at_s = time.monotonic() + _COMPLAIN_S
                self._log.warning('waits: a reader of %s takes no more', self._publisher.topic)
            time.sleep(_FULL_S)

    def _publish(self, text: String) -> bool:
        try:
            self._publisher.publish(text)
        except rclpy_implementation.RCLError as error:
            if 'cannot publish data' not in str(error):  # a full history has no class of its own
                raise
            return False
        return True


class Gate(MutuallyExclusiveCallbackGroup):
    """Lets a subscription be taken only while `is_open` says so; DDS keeps what comes meanwhile.

    When its history is full, too, the publisher waits: this is how a module holds back the bridge,
    and the bridge holds back Kafka.
    """

    def __init__(self, is_open: Callable[[], bool]) -> None:
        super().__init__()
        self._is_open = is_open

    def can_execute(self, entity: Any) -> bool:
        """Whether the executor may take now."""
        return self._is_open() and super().can_execute(entity)


class Module:
    """A module in its ROS node.

    Attributes:
        name: That of its file, its node and its place in `ros2_kafka_warehouse.topics`.
        site: Where it works.
    """

    def __init__(self, name: str, node: Node, settings: Settings, log: logging.Logger) -> None:
        self.name = name
        self.node = node
        self.settings = settings
        self.site: Site = read_site(settings.site)
        self.log = log
        self._work: Callable[[], None] | None = None
        self._needs: Sequence[Newest[Any] | Queue[Any]] = ()
        self._has_worked = False
        self._has_settled = False
        self._settling: Any = None
        self._guard = node.create_guard_condition(self._work_if_ready)
        self._ends: list[Callable[[], None]] = []

    def now_s(self) -> float:
        """Seconds since the epoch."""
        return time.time()

    # Hearing

    def newest(self, topic: str, kind: type[M], *, asks: bool = True) -> Newest[M]:
        """Keep the newest message of a topic; each one that comes asks for work, if it `asks`."""
        newest: Newest[M] = Newest()

        def keep(message: M) -> None:
            newest.or_none = message
            if asks:
                self.ask()

        self.each(topic, kind, keep, depth=1)
        return newest

    def queue(self, topic: str, kind: type[M], *, asks: bool = True) -> Queue[M]:
        """Keep all messages of a topic until the work takes them; each `asks` for that."""
        queue: Queue[M] = Queue()

        def add(message: M) -> None:
            queue.add(message)
            if asks:
                self.ask()

        self.each(topic, kind, add)
        return queue

    def each(
        self,
        topic: str,
        kind: type[M],
        callback: Callable[[M], None],
        *,
        gate: CallbackGroup | None = None,
        depth: int = 50,
        refuse: Callable[[str, MessageError], None] | None = None,
    ) -> None:
        """Call back for every message of a topic, in order.

        Args:
            topic: One of `ros2_kafka_warehouse.topics` that this module subscribes to.
            kind: What it holds.
            callback: Gets the message.
            gate: Says when it may be taken.
            depth: Of a latched topic: how many may wait here.
            refuse: Gets a text that is no such message; else the log says so.
        """
        spec = _topic(topic)
        assert self.name in spec.subscribers, f'{self.name} does not hear {topic}'

        def on_text(text: String) -> None:
            try:
                message = decode(text.data, kind)
            except MessageError as error:
                self.log.error('%s: %s', topic, error)  # noqa: TRY400 (the text says all)
                if refuse is not None:
                    refuse(text.data, error)
                return
            callback(message)

        self.node.create_subscription(
            String, topic, on_text, qos_of(spec, depth), callback_group=gate
        )

    # Saying

    def speaker(self, topic: str) -> Speaker:
        """What says the messages of a topic."""
        spec = _topic(topic)
        assert self.name in spec.publishers, f'{self.name} does not say {topic}'
        publisher = self.node.create_publisher(String, topic, qos_of(spec, _KEPT))
        return Speaker(publisher, self.log, is_snapshot=spec.latched and not spec.history)

    def ros_publisher(self, topic: str, kind: type[Any], *, latched: bool = False) -> Any:
        """A publisher of a standard type; one for each robot is many: without events."""
        return self.node.create_publisher(
            kind,
            topic,
            _latched(1) if latched else QoSProfile(depth=1),
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )

    # Working

    def work_on(self, work: Callable[[], None], *needs: Newest[Any] | Queue[Any]) -> None:
        """Call `work` when something has come, once all that it needs is there."""
        self._work = work
        self._needs = needs

    def ask(self) -> None:
        """Ask for work, from any thread: it is done when all that waits has been taken."""
        self._guard.trigger()

    def each_s(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Call back again and again; returns the timer."""
        return self.node.create_timer(period_s, callback)

    def at_end(self, callback: Callable[[], None]) -> None:
        """Call back when the module ends in order."""
        self._ends.append(callback)

    def end(self) -> None:
        """Let go of what was made."""
        for callback in self._ends:
            callback()

    def _work_if_ready(self) -> None:
        if self._work is None or any(need.or_none is None for need in self._needs):
            return
        if not self._has_settled:
            self._settle()
            return
        self._work()
        if not self._has_worked:
            self._has_worked = True
            self.log.info('works')

    def _settle(self) -> None:
        """Wait once, before the first work.

        A latched writer sends the ten snapshots that it keeps one after the other: who began with
        the first of them would go on from what was long ago.
        """
        if self._settling is not None:
            return

        def settled() -> None:
            assert self._settling is not None
            self._settling.cancel()
            self._has_settled = True
            self._work_if_ready()

        self._settling = self.each_s(_SETTLE_S, settled)


def qos_of(topic: Topic, depth: int = 1) -> QoSProfile:
    """The QoS of a topic, for its publishers and (with a depth of their own) its subscribers."""
    if topic.history or not topic.latched:
        # Nothing is overwritten: whoever is too slow holds its publisher back.
        return QoSProfile(
            depth=0,
            history=HistoryPolicy.KEEP_ALL,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if topic.history
            else DurabilityPolicy.VOLATILE,
        )
    return _latched(depth)


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _topic(name: str) -> Topic:
    return next(topic for topic in TOPICS if topic.name == name)
