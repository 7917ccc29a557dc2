"""What `check` finds of the type of a route: it is found out once, and as its route does it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ros2_kafka_bridge.commands.check.ros import publishers
from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError
from ros2_kafka_bridge.message_types.description import make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.size import largest_message_bytes
from ros2_kafka_bridge.message_types.source import TypeSource
from ros2_kafka_bridge.ros.matching import type_of
from ros2_kafka_bridge.ros.message_sizes import Sizes
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.shown_types import TypeOrError, load_all
from ros2_kafka_bridge.ros.types import WantedType
from ros2_kafka_bridge.ros.used_type import RosEnd, RouteTypes, waits_for


class FoundType(NamedTuple):
    """What is known of the type of a route.

    Args:
        name: None while it is open.
        layout: None where nobody tells what it looks like, or not yet.
        type_hash: None where it is not known.
        found: What is said of that.
    """

    name: str | None = None
    layout: Layout | None = None
    type_hash: str | None = None
    found: Sequence[Finding] = ()


def named_type(route: AnyRoute, config: Config) -> FoundType:
    """The type that the file names, without asking anybody."""
    topic, name, _ = RosEnd.of(route)
    if name is None:
        return FoundType()
    source = TypeSource.of(config.ros)
    if problem := source.unsettled(name):
        text = f'{problem}: a node that uses {topic} is asked for it'
        return FoundType(name, found=[Finding('note', 'type', text)])
    try:
        layout = make_layout(name, source.describe(name))
    except ConfigError as error:
        return FoundType(name, found=[Finding('bad', 'type', str(error))])
    return FoundType(name, layout, layout.type_hash)


def find_types(config: Config, node: RosNode) -> dict[str, FoundType]:
    """The types of all routes, by their names; nodes are asked for those that are not here."""
    types = RouteTypes(node, config.ros)
    found: dict[str, FoundType] = {}
    wanted: dict[str, WantedType] = {}
    for route in config.routes:
        try:
            seen = _seen_type(route, config, node, types)
        except BridgeError as error:
            seen = FoundType(found=[Finding('bad', 'graph', str(error))])
        if isinstance(seen, WantedType):
            wanted[route.name] = seen
        else:
            found[route.name] = seen
    loaded = load_all(types.loader, [*wanted.values()])
    for (name, one), it in zip(wanted.items(), loaded, strict=True):
        is_here = types.loader.unsettled(one.name) is None
        found[name] = _loaded_type(one.name, it, is_here=is_here)
    return found


def sizes_of(config: Config, types: Mapping[str, FoundType]) -> Sizes:
    """How large the messages of routes may be whose types were found."""
    return {
        route.name: largest_message_bytes(layout, route.max_message_bytes)
        for route in config.routes
        if (layout := types[route.name].layout) is not None
    }


def _seen_type(
    route: AnyRoute, config: Config, node: RosNode, types: RouteTypes
) -> FoundType | WantedType:
    """What a route would load now; or that it has to wait.

    Raises:
        BridgeError: Somebody in the graph cannot be read.
    """
    end = RosEnd.of(route)
    name = route.type_name
    if route.type_name is None:
        name = type_of(route, publishers(route, config, node))
    if name is None:  # nobody publishes, or two types: which is said there
        return FoundType()
    if wanted := types.find(end, _at_once):
        return wanted
    if end.said is None:  # a route of this file alone would publish it
        return WantedType(name)
    text = f'the route {waits_for(end.topic, types.loader.unsettled(name))}'
    waits = f'for a node that uses {end.topic}'
    return FoundType(name, found=[Finding('note', 'type', text, waits=waits)])


def _at_once(_pause_s: float) -> bool:
    """Wait for nobody."""
    return True


def _loaded_type(name: str, loaded: TypeOrError, *, is_here: bool) -> FoundType:
    if not isinstance(loaded, BridgeError):
        said = Finding('ok', 'type', f'{name} {loaded.origin}')
        return FoundType(name, loaded.layout, loaded.type_hash, [said])
    # What is not here has its cure in the error.
    is_broken = is_here and isinstance(loaded, RouteError)
    cure = 'mend its package, or build it anew for this Python and this ROS' if is_broken else ''
    return FoundType(name, found=[Finding('bad', 'type', str(loaded), cure)])
