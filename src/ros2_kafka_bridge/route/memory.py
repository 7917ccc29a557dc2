"""How much memory a route may take, beside what its process takes without it.

docs/tuning.md says what is not in it. librdkafka reads on by one answer of the broker, and copies
what it is to send.
"""

from typing import Final, NamedTuple

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.logs.text import in_mb
from ros2_kafka_bridge.route.counters import Counters
from ros2_kafka_bridge.route.format import reads_fields
from ros2_kafka_bridge.route.pieces import PIECE

TAKE_BYTES: Final = 4 << 20
"""What one take from ROS ends with, where the window has room for it."""

FRAME_BYTES: Final = 10_000
"""Of key, headers and protocol around a message."""

_ANSWER_BYTES: Final = 1 << 20


class Kept(NamedTuple):
    """What DDS keeps for a route: in the cache of its reader, or the history of its writer.

    Args:
        samples: How many messages; in a reader, for each QoS that publishers offer.
        size_bytes: How large one may be; None where only what it holds says so.
    """

    samples: int
    size_bytes: int | None

    def largest_bytes(self, route: AnyRoute) -> int:
        """How large one may be; of what has no size, as large as the route takes."""
        return self.size_bytes or route.max_message_bytes


def most_memory(route: AnyRoute, kept: Kept, prefetch_bytes: int) -> int:
    """How much memory a route may take, in bytes.

    Args:
        route: Its settings.
        kept: What DDS keeps for it.
        prefetch_bytes: What its consumer reads ahead.
    """
    largest_bytes = kept.largest_bytes(route)
    in_flight = _IN_FLIGHT[route.direction](route, largest_bytes, prefetch_bytes)
    return kept.samples * largest_bytes + in_flight


def _to_ros(route: AnyRoute, largest_bytes: int, prefetch_bytes: int) -> int:
    """What is read ahead, as much behind a full window, that, and its dead letters."""
    read_bytes = prefetch_bytes + max(_ANSWER_BYTES, route.max_message_bytes)
    grown_bytes = PIECE * largest_bytes if reads_fields(route) else 0
    behind_bytes = max(read_bytes, grown_bytes)
    return read_bytes + behind_bytes + _window_bytes(route, largest_bytes) + queue_bytes(route)


def _to_kafka(route: AnyRoute, largest_bytes: int, _prefetch_bytes: int) -> int:
    """The window and a take, that take before it is encoded, and what the producer has of all."""
    taken_bytes = take_bytes(route) + max(largest_bytes, route.max_message_bytes)
    return _window_bytes(route, largest_bytes) + 2 * taken_bytes + queue_bytes(route)


def _window_bytes(route: AnyRoute, largest_bytes: int) -> int:
    """What is in flight; where the oldest are dropped, as much waits as the sink has."""
    if not route.drops:
        return route.max_in_flight_bytes
    return 2 * max(route.max_in_flight_bytes, route.max_message_bytes, largest_bytes)


_IN_FLIGHT: Final = {Direction.KAFKA_TO_ROS: _to_ros, Direction.ROS_TO_KAFKA: _to_kafka}
_LIMITS: Final = {
    Direction.KAFKA_TO_ROS: 'max_in_flight',
    Direction.ROS_TO_KAFKA: 'max_samples',
}
"""What bounds the messages that DDS keeps, where their size does not."""


def take_bytes(route: AnyRoute) -> int:
    """With how much one take from ROS ends."""
    return min(TAKE_BYTES, route.max_in_flight_bytes)


def queue_bytes(route: AnyRoute) -> int:
    """How much the queue of a producer holds: the window, or one message of any size allowed."""
    return max(route.max_in_flight_bytes, route.max_message_bytes + FRAME_BYTES)


def in_words(route: AnyRoute, kept: Kept, prefetch_bytes: int) -> str:
    """Say how much memory a route may take, and how much of it DDS does.

    Args:
        route: As of `most_memory`.
        kept: As of `most_memory`.
        prefetch_bytes: As of `most_memory`.
    """
    most = in_mb(most_memory(route, kept, prefetch_bytes))
    messages = f'{kept.samples:,} messages ({_limit(route, kept)})'
    if kept.size_bytes is None:
        each = f'{route.max_message_bytes:,} bytes (max_message_bytes)'
        return f'at most {most} of memory, if each of the {messages} that DDS keeps had {each}'
    return f'at most {most} of memory: DDS keeps {messages} of up to {kept.size_bytes:,} bytes'


def _limit(route: AnyRoute, kept: Kept) -> str:
    """What bounds the number of messages that DDS keeps."""
    if kept.samples == route.ros_history(None):
        return 'depth' if kept.samples == route.qos.depth else _LIMITS[route.direction]
    if kept.samples > route.ros_history(kept.size_bytes):
        return 'more than this route needs'
    return 'max_cache_bytes'


def note_memory(
    counters: Counters, route: AnyRoute, kept: Kept, prefetch_bytes: int, log: Log, *, known: bool
) -> None:
    """Note how much memory a route may take, and say it where its messages may be large.

    Args:
        counters: Of the route.
        route: As of `most_memory`.
        kept: As of `most_memory`.
        prefetch_bytes: As of `most_memory`.
        log: Of the route.
        known: Whether the size of its messages was known when the process joined the graph.
    """
    counters.memory_limit = most_memory(route, kept, prefetch_bytes)
    fitting = route.ros_history(kept.size_bytes)
    if fitting < kept.samples and not known:
        log.warning(
            '%s; %d would fit into max_cache_bytes, but what the type of %s is was not known when '
            'the bridge started: %s, or start it again while somebody uses it',
            in_words(route, kept, prefetch_bytes), fitting, route.ros_topic,
            'give its .msg files in ros.message_path' if route.type_name else 'set from.type',
        )  # fmt: skip
    elif kept.samples < route.ros_history(None):
        log.info('%s', in_words(route, kept, prefetch_bytes))
