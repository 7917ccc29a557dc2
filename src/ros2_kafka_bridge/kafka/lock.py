"""The right to run a route alone, held through a consumer group of Kafka.

Every bridge that may run the route is a member of one group on a topic of one partition. Who has
the partition runs the route; nothing is ever read from it.

Tried with two and three members, librdkafka 2.x and Apache Kafka 4 (session 6 s, heartbeat 1 s):

- A newcomer takes nothing away: cooperative-sticky leaves the partition where it is, and calls
  `on_assign` of every member with an empty list, also of the holder.
- SIGTERM of the holder: another has the partition within 0.1 s. It must unsubscribe first: a
  member with a name stays in the group when it only closes.
- SIGKILL or SIGSTOP of the holder: another has it after 6 to 7 s, when the session has ended.
- SIGCONT after that: `on_lost` at once, `on_assign` with an empty list up to 1 s later. Between
  the two nobody has said who holds it.
- Kafka away for less than 6 s: nothing is called back. For longer: `on_lost` of every member
  after 6 s, though none has lost it to another. Once Kafka answers, a member with a name
  (`group.instance.id`, made anew in every life) gets its old place within 0.2 s: the holder holds
  on. Without names, all would wait 6 s more for the members of before the outage to expire, and
  then any of them would get it.
- A request of before a break of the network that comes late, behind the ones of after it: Kafka
  takes it for another member of the same name, and the client gives up for good. A new one of that
  name gets its place; where that is shut out, too, one of another name waits for the session of
  the old one to end.
- A client that has lost its place and says nothing any more, though it is connected: seen where
  all brokers were killed. Another takes its place as well.
"""

import time
from collections.abc import Mapping
from enum import Enum
from typing import Any, Final, Self

from confluent_kafka import Consumer, KafkaException

from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError
from ros2_kafka_bridge.kafka.admin import Admin
from ros2_kafka_bridge.kafka.client_health import BROKERS_LOST, ClientHealth
from ros2_kafka_bridge.kafka.errors import Client, is_missing_topic, translate, translated
from ros2_kafka_bridge.kafka.group_client import GroupClient
from ros2_kafka_bridge.kafka.names import lock_group, lock_topic
from ros2_kafka_bridge.kafka.properties import (
    Membership,
    common_properties,
    consumer_properties,
    member_name,
)
from ros2_kafka_bridge.kafka.topic_partitions import at
from ros2_kafka_bridge.kafka.topics import ensure_topic
from ros2_kafka_bridge.logs.lines import Log, client_log

HEARTBEAT_MS: Final = 1000
_REQUEST_S: Final = 5.0
_TOPIC_S: Final = 10.0  # until a topic just made is known
_AGAIN_S: Final = 0.2
_CLOSE_S: Final = 2.0
_NEW_CLIENT_EVERY_S: Final = 1.0
# Connected, and not told who holds it: a session that ends (6 s) and an election fit in. The next
# client waits twice as long: Kafka may be slow.
_UNTOLD_S: Final = 10.0
_MOST_UNTOLD_S: Final = 80.0
# A name that was shut out again within so long is given up.
_SHORT_LIFE_S: Final = 30.0
# A cable that is pulled looks the same for a while: less is said than of a client that is stuck.
_LAST_LINES: Final = 30


class _Useless(Enum):
    """Why a client would never tell anything."""

    SHUT_OUT = 'the group has shut out its client'
    SILENT = 'Kafka has not said for long who runs this route'
    LOST = BROKERS_LOST


class GroupLock:
    """The exclusive right of one bridge to run a route. Called by one thread at a time.

    Args:
        kafka: librdkafka properties as the user wrote them.
        bridge: Name of the bridge: all that share it and the route take turns.
        route: Name of the route.
        log: Where to say that Kafka is away.
        membership: Of the group.
    """

    def __init__(
        self,
        kafka: Mapping[str, Any],
        bridge: str,
        route: str,
        log: Log,
        membership: Membership = 'static',
    ) -> None:
        self.topic = lock_topic(bridge)
        self.group = lock_group(bridge, route)
        self.held = False  # as far as is known: see `poll`
        self.joined = False  # whether the group has told who holds it
        users = {
            n: v for n, v in kafka.items() if n not in {'group.protocol', 'group.remote.assignor'}
        }
        self._membership = membership
        own = member_name({}, membership) | {'heartbeat.interval.ms': HEARTBEAT_MS}
        properties = consumer_properties(users, group=self.group, client_id=bridge)
        self._properties = {**properties, **own}
        self._common = common_properties(kafka, client_id=bridge)
        self._about = Client('READ', self._properties)
        self._log = log
        self._health = ClientHealth(f'topic {self.topic}', log, self._about, reads=True)
        self._client: GroupClient | None = None
        self._new_client_at_s = 0.0
        self._shut_out_s = -_SHORT_LIFE_S  # when it was last
        self._untold_s = _UNTOLD_S
        self._untold_since_s: float | None = None  # connected, and not told who holds it
        self._assigned = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def away(self) -> str:
        """Why Kafka does not tell who holds it; empty when all is well."""
        return self._health.away

    def open(self) -> None:
        """Join those who want to hold it; nothing where that is done already.

        Raises:
            RouteError: The topic is not there and cannot be made, or is not as it must be.
            TransportError: Kafka is away.
        """
        if self._client is not None:
            return
        ensure_topic(self._common, self.topic)
        self._health.on_open()
        try:
            with translated(f'topic {self.topic}', self._about):
                self._client = self._new_client()
                self._check_topic(self._client.consumer)
                self._join(self._client)
        except BridgeError:
            self.close()
            raise

    def poll(self, timeout_s: float) -> None:
        """Learn whether it is held; returns after `timeout_s`. A closed one stays as it is.

        Who was the holder when Kafka went away stays the holder for itself, until Kafka says
        that another is: both can be at work for that time, but a message is never left to nobody.
        A client that is of no use any more is replaced: that is never a failure of the route.
        """
        if (client := self._client) is None:
            return
        try:
            message = client.consumer.poll(timeout_s)
            error = None if message is None else message.error()
        except KafkaException as raised:  # fatal for the client
            error, client.is_shut_out = raised.args[0], True
        if error is not None:
            client.is_shut_out = client.is_shut_out or error.fatal()
            client.on_error(error)
        reason = self._find_useless(client)
        if reason is not None and time.monotonic() >= self._new_client_at_s:
            self._join_anew(client, reason)

    def _find_useless(self, client: GroupClient) -> _Useless | None:
        if client.is_shut_out:
            return _Useless.SHUT_OUT
        if self._health.has_lost_brokers:
            return _Useless.LOST
        return _Useless.SILENT if self._is_untold() else None

    def _is_untold(self) -> bool:
        """Whether Kafka has not said for long who holds it, though it could."""
        if self.joined or not self._health.is_connected:
            self._untold_since_s = None
            return False
        now_s = time.monotonic()
        if self._untold_since_s is None:
            self._untold_since_s = now_s
        return now_s - self._untold_since_s > self._untold_s

    def check(self) -> None:
        """Look whether anything keeps this bridge from ever holding it.

        Raises:
            RouteError: The group or the topic may not be used, or is not there.
        """
        self._health.raise_failure()

    def has_standby(self) -> bool:
        """Whether another bridge stands by; False, with a warning, where Kafka does not tell."""
        deadline_s = time.monotonic() + _REQUEST_S
        problem = ''
        while not problem:
            left_s = deadline_s - time.monotonic()
            try:
                return self._members(max(_AGAIN_S, left_s)) > 1
            except (KafkaException, TimeoutError, BridgeError) as error:
                problem = '' if left_s > _AGAIN_S else str(error) or 'it does not answer'
            time.sleep(_AGAIN_S)
        self._log.warning('Kafka does not tell whether another bridge stands by (%s)', problem)
        return False

    def _members(self, within_s: float) -> int:
        """How many bridges want to hold it, or do."""
        requests = Admin(self._common, __name__).requests
        asked = requests.describe_consumer_groups([self.group], request_timeout=within_s)
        return len(asked[self.group].result(within_s).members)

    def close(self) -> None:
        """Leave it to another."""
        client, self._client = self._client, None
        self._note_new_client()
        self.held = False
        if client is not None:
            client.end(_CLOSE_S, leaves=True)

    def _new_client(self) -> GroupClient:
        client = GroupClient(self._properties, self.topic, self._health, client_log(__name__))
        client.open()
        return client

    def _join(self, client: GroupClient) -> None:
        client.subscribe(self._on_assign, self._on_revoke, self._on_lost)

    def _note_new_client(self) -> None:
        self.joined = self._assigned = False
        self._untold_since_s = None

    def _join_anew(self, old: GroupClient, reason: _Useless) -> None:
        """Put another client in the place of one that would never tell anything.

        The holder holds on meanwhile, as it does while Kafka is away. Under the same name it has
        its place back at once; a name that was shut out twice is given up.
        """
        self._log.warning('%s: joins the bridges of this route anew', reason.value)
        if reason is _Useless.SILENT:
            old.recorder.tell(self._log, _LAST_LINES)
        now_s = time.monotonic()
        self._new_client_at_s = now_s + _NEW_CLIENT_EVERY_S
        is_shut_out = reason is _Useless.SHUT_OUT
        before = self._properties
        if is_shut_out and now_s - self._shut_out_s < _SHORT_LIFE_S:
            self._properties = {**before, **member_name({}, self._membership)}
        new = None
        try:
            new = self._new_client()
            self._join(new)
        except (KafkaException, BridgeError) as error:  # a file that is being replaced, perhaps
            self._log.warning('cannot join them now: %s', error)
            self._properties = before
            if new is not None:
                new.end(0.0, leaves=False)
            return
        self._client = new
        self._health.on_open()
        self._note_new_client()
        if is_shut_out:
            self._shut_out_s = now_s
        elif reason is _Useless.SILENT:
            self._untold_s = min(_MOST_UNTOLD_S, 2 * self._untold_s)
        # Not waited for: a route may run by this lock.
        old.end(0.0, leaves=self._properties is not before)

    def _check_topic(self, consumer: Consumer) -> None:
        deadline_s = time.monotonic() + _TOPIC_S
        while True:
            found = consumer.list_topics(self.topic, timeout=_REQUEST_S).topics[self.topic]
            if found.error is None or time.monotonic() > deadline_s:
                break
            problem = translate(found.error, f'topic {self.topic}', self._about)
            if not isinstance(problem, TransportError) and not is_missing_topic(found.error):
                raise problem
            time.sleep(_AGAIN_S)
        if found.error is not None:
            if not is_missing_topic(found.error):
                raise translate(found.error, f'topic {self.topic}', self._about)
            raise RouteError(
                f'topic {self.topic}, by which bridges agree on who runs an exclusive route, is '
                f'not there, and this user may not create it: {self._command}'
            )
        if len(found.partitions) != 1:
            raise RouteError(
                f'topic {self.topic} has {len(found.partitions)} partitions, and an exclusive '
                f'route needs it with one: delete the topic, then {self._command}'
            )

    @property
    def _command(self) -> str:
        servers = self._common.get('bootstrap.servers', '...')
        return (
            f'kafka-topics.sh --bootstrap-server {servers} --create --topic {self.topic} '
            '--partitions 1'
        )

    def _on_assign(self, numbers: frozenset[int]) -> None:
        self._health.on_contact()
        self._health.forget_failure()
        self.joined = True
        self._untold_s = _UNTOLD_S
        if numbers and self._client is not None:
            # From an offset that nobody has to look up, and never read.
            places = at(self.topic, dict.fromkeys(numbers, 0))
            self._client.consumer.incremental_assign(places)
            self._client.consumer.pause(places)
            self._assigned = True
        # An empty list after a loss says that another has it; otherwise that nothing changes.
        self.held = self._assigned

    def _on_revoke(self, _: frozenset[int]) -> None:
        self._assigned = self.held = False

    def _on_lost(self, _: frozenset[int]) -> None:
        self._assigned = self.joined = False
