"""What is said about what can never be delivered: in the log, and in its dead letter."""

from typing import NamedTuple

from ros2_kafka_bridge.config.settings import KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.dead_letters.letter import Letter, parse
from ros2_kafka_bridge.dead_letters.writer import explain, from_kafka, from_ros, without_value
from ros2_kafka_bridge.dedup import place_in
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing, Record
from ros2_kafka_bridge.errors import (
    About,
    LoopError,
    RecordError,
    RecordTooLargeError,
    RouteError,
    TimestampError,
)
from ros2_kafka_bridge.logs.summed import FIRST, Summed
from ros2_kafka_bridge.route.identity import Identify, Identity
from ros2_kafka_bridge.route.trace_context import trace_id_of


class Rejection(NamedTuple):
    """A record or message that was refused.

    Args:
        error: Why.
        where: It was, in words.
        about: The same, as fields of a line of the log.
    """

    error: RecordError
    where: str
    about: About

    @property
    def text(self) -> str:
        """Where and why."""
        return f'{self.where}: {self.error}'

    def policy(self, on_error: str) -> str:
        """What is done about it: what the route says, but a wrong clock or a bug drops nothing."""
        may_be_good = self.error.bug is not None or isinstance(self.error, TimestampError)
        return 'dead_letter' if on_error == 'drop' and may_be_good else on_error

    def tell(self, policy: str, sums: Summed) -> None:
        """Say what is done about it; one line for what all records may share."""
        is_shared = isinstance(self.error, LoopError | TimestampError)
        kind, first = (type(self.error).__name__, 1) if is_shared else ('', FIRST)
        sums.warning(f'{policy}: {self.text}', about=self.about, kind=kind, first=first)

    def tell_bug(self, sums: Summed) -> None:
        """Log a bug of the bridge with its traceback, whatever the route does about it."""
        if self.error.bug is not None:
            sums.error(self.text, about=self.about, bug=self.error.bug)

    def failure(self, given_up: str = '') -> RouteError:
        """What ends a route whose `on_error` is `stop`.

        Args:
            given_up: What that costs, behind a comma.
        """
        text = f'{self.text}; stopped, as on_error says{given_up}'
        return RouteError(text, final=True, about=self.about)


def rejection_of_record(
    route: KafkaToRosRoute, record: Record, headers: HeaderList | None, error: RecordError
) -> Rejection:
    """A record that was refused.

    Args:
        route: Its route.
        record: As it came.
        headers: Of it, None where they cannot be read.
        error: Why.
    """
    topic, partition, offset = _place(route, record)
    about = about_labelled(headers, error)._replace(
        topic=topic, partition=partition, offset=offset
    )
    return Rejection(error, f'{topic}[{partition}]@{offset}', about)


def rejection_of_message(
    route: RosToKafkaRoute, headers: HeaderList, error: RecordError
) -> Rejection:
    """A message that was refused.

    Args:
        route: Its route.
        headers: Of the record that it was to become.
        error: Why.
    """
    ros_topic, topic = route.ros_topic, route.kafka_topic
    about = about_labelled(headers, error)._replace(topic=topic, ros_topic=ros_topic)
    return Rejection(error, f'{ros_topic} -> {topic}', about)


def letter_of_record(
    route: KafkaToRosRoute, record: Record, headers: HeaderList | None, error: RecordError
) -> Outgoing:
    """The dead letter of a record; the arguments are those of `rejection_of_record`."""
    origin = from_kafka(route.name, *_place(route, record))
    letter = Outgoing('', record.key(), record.value(), headers or [])
    unread = '' if headers is not None else 'a name is not UTF-8'
    return explain(letter, error, origin, unread)


def _place(route: KafkaToRosRoute, record: Record) -> tuple[str, int, int]:
    return route.kafka_topic, record.partition() or 0, record.offset() or 0


def letter_of_message(route: RosToKafkaRoute, record: Outgoing, error: RecordError) -> Outgoing:
    """The dead letter of a message.

    Args:
        route: Its route.
        record: That it was to become.
        error: Why it was refused.
    """
    origin = from_ros(route.name, route.ros_topic, route.kafka_topic)
    letter = explain(record, error, origin)
    return without_value(letter) if isinstance(error, RecordTooLargeError) else letter


def message_of_letter(
    route: RosToKafkaRoute, identify: Identify, record: Record
) -> Identity | None:
    """Which message it was that the route has refused.

    Args:
        route: The route.
        identify: Reads which message a record of the route carries; a letter keeps its headers.
        record: Of its dead-letter topic. Of the letters of another route, which may share that
            topic, and of anything else it tells nothing.
    """
    found = parse(route.dead_letter_topic, record)
    if not isinstance(found, Letter) or (about := found.about) is None:
        return None
    way = (route.name, route.ros_topic, route.kafka_topic)
    if (about.route, about.ros_topic, about.topic) != way:
        return None
    return identify(found.headers)


def about_labelled(headers: HeaderList | None, error: RecordError | None = None) -> About:
    """What the headers of a record tell, which anyone may have written, and an error."""
    gid, seq = place_in(headers or []) or (b'', None)
    return About(
        gid=gid.hex() or None,
        seq=seq,
        trace_id=trace_id_of(headers),
        error=None if error is None else type(error).__name__,
    )
