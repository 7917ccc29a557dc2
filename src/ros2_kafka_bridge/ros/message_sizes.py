"""How large the messages of routes may be, and so how many of them DDS keeps.

That stands in the profile of a process, which counts from the time when it joins the graph on. So
what the graph alone tells is looked up by another process before, once: nobody is waited for.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.message_types.description import make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.size import largest_message_bytes
from ros2_kafka_bridge.message_types.source import TypeSource
from ros2_kafka_bridge.ros.discovery import ANNOUNCED_S, partial_view
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import import_rclpy, is_fastdds, users_environ
from ros2_kafka_bridge.ros.probe import SAMPLES
from ros2_kafka_bridge.ros.size_lookup import SizedEnd, SizeQuestion, ask
from ros2_kafka_bridge.threads.stop import Stop

Sizes = Mapping[str, int | None]
"""Route -> how large its messages may be, in bytes; None where only what they hold says so.

It is left out where its type is not known.
"""


def described_sizes(config: Config) -> Sizes:
    """The sizes of messages whose types the file names and somebody here describes.

    A route that names none has the type that another route of the file names for its topic.
    """
    source = TypeSource.of(config.ros)

    @cache
    def layout_of(name: str) -> Layout | None:
        with suppress(BridgeError):  # its route tells it
            if source.unsettled(name) is None:
                return make_layout(name, source.describe(name))
        return None

    of_topics = {route.ros_topic: route.type_name for route in config.routes if route.type_name}
    names = ((route, route.type_name or of_topics.get(route.ros_topic)) for route in config.routes)
    return {
        route.name: largest_message_bytes(layout, route.max_message_bytes)
        for route, name in names
        if name is not None and (layout := layout_of(name)) is not None
    }


def message_sizes(
    config: Config, routes: Sequence[AnyRoute], bridge: str, stop: Stop, log: Log
) -> Sizes:
    """The sizes of the messages of routes; those of other types than described ones, as seen.

    Args:
        config: With all routes.
        routes: Those of this process, which has not joined the graph.
        bridge: The name of the process there.
        stop: Ends the look.
        log: Where to say whom it is for, and what is not known.

    Raises:
        ConfigError, RouteError: There is no ROS here, or it cannot be loaded.
    """
    sizes = described_sizes(config)
    unknown = [it for it in routes if it.name not in sizes and not it.has_fixed_history]
    if not unknown:
        return sizes
    import_rclpy()
    if not is_fastdds():  # no other middleware counts by the profile
        return sizes
    environ = users_environ()
    if not partial_view(environ):
        log.info(
            'looks who uses %s, for %g s where nobody does: how large messages are there is not '
            'known here',
            ', '.join(_topics(unknown)), ANNOUNCED_S,
        )  # fmt: skip
        found = ask(_question(unknown, config.ros, bridge), environ, stop, log)
        sizes = {**sizes, **{unknown[it.number].name: it.size_bytes for it in found}}
    if late := [route for route in unknown if route.name not in sizes]:
        log.info(
            'how large messages of %s are is not known: DDS keeps as many as of small ones. If '
            'they are large, set from.type',
            ', '.join(_topics(late)),
        )  # fmt: skip
    return sizes


def _topics(routes: Iterable[AnyRoute]) -> Iterable[str]:
    return dict.fromkeys(route.ros_topic for route in routes)


def _question(routes: Sequence[AnyRoute], ros: RosSettings, bridge: str) -> SizeQuestion:
    ends = [SizedEnd(it.ros_topic, it.type_name, it.max_message_bytes) for it in routes]
    folders = [str(folder) for folder in TypeSource.of(ros).folders]
    return SizeQuestion(bridge, ros.domain_id, ros.lease_s, folders, ends)


def histories_of(
    routes: Iterable[AnyRoute], sizes: Sizes, probed: str, lease_s: float | None
) -> Histories:
    """List the ROS endpoints of the routes, with the lengths of their histories.

    Args:
        routes: The routes.
        sizes: How large their messages may be.
        probed: A topic on which it is tried what the middleware does.
        lease_s: As of the file.
    """
    lengths = {direction: {probed: SAMPLES} for direction in Direction}
    for route in routes:
        known, topic = lengths[route.direction], route.ros_topic
        history = route.ros_history(sizes.get(route.name))
        known[topic] = max(known.get(topic, 0), history)
    return Histories(lengths[Direction.KAFKA_TO_ROS], lengths[Direction.ROS_TO_KAFKA], lease_s)
