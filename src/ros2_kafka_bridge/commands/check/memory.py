"""How much memory the routes of a configuration would take."""

from collections.abc import Mapping

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.kafka.properties import prefetch_bytes
from ros2_kafka_bridge.logs.text import in_mb
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros.message_sizes import Sizes, histories_of
from ros2_kafka_bridge.route.memory import Kept, in_words, most_memory


def kept_by_routes(config: Config, sizes: Sizes) -> Mapping[str, Kept]:
    """What DDS would keep for each route."""
    histories = histories_of(config.routes, sizes, '', None)
    samples = {
        Direction.KAFKA_TO_ROS: histories.writers, Direction.ROS_TO_KAFKA: histories.readers,
    }  # fmt: skip
    return {
        route.name: Kept(samples[route.direction][route.ros_topic], sizes.get(route.name))
        for route in config.routes
    }


def memory_finding(route: AnyRoute, config: Config, kept: Kept, layout: Layout | None) -> Finding:
    """How much memory a route would take, and what of it DDS keeps."""
    text = in_words(route, kept, prefetch_bytes(config.kafka))
    if layout is not None or route.has_fixed_history:
        return Finding('ok', 'memory', text)
    cure = 'put its .msg files into a folder of ros.message_path'
    return Finding(
        'note',
        'memory',
        f'{text}: if the type is not known when the bridge starts, large messages are kept as if '
        'they were small',
        cure if route.type_name else 'set from.type',
    )


def memory_words(route: AnyRoute, config: Config, kept: Kept) -> str:
    """The same in short, for who looks at the file alone; empty where that says no size."""
    if kept.size_bytes is None:
        return ''
    return f', at most {in_mb(most_memory(route, kept, prefetch_bytes(config.kafka)))} of memory'
