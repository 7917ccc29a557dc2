"""The node of a process in the ROS graph, and what it sees there."""

import logging
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError, blamed
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.outside.extras import how_to_get_ros
from ros2_kafka_bridge.ros.errors import translated
from ros2_kafka_bridge.ros.fastdds_profile import (
    FASTDDS_2,
    FASTDDS_3,
    Dialect,
    Histories,
    make_profile,
    user_profile,
    written,
)
from ros2_kafka_bridge.ros.graph import Changes, Graph
from ros2_kafka_bridge.ros.installation import (
    check_alone,
    check_api,
    rclpy_major,
    rclpy_version,
)
from ros2_kafka_bridge.ros.peer import BRIDGE_PREFIX, Peer
from ros2_kafka_bridge.ros.profile_check import check_profile, check_topic
from ros2_kafka_bridge.ros.rclpy_api import NeededBy

_FASTDDS = 'rmw_fastrtps'
_FIRST_WITH_FASTDDS_3 = 8
_LONGEST = 200
# ROS would make a file for each process and start, below a home that may be missing or read-only,
# and refuse to run without it. What it says is said on stderr, too, and that is the bridge's log.
_NO_LOG_FILES = ['--ros-args', '--disable-external-lib-logs']
_STARTING = threading.Lock()  # two starts in one process would mix their environments


class Topic(NamedTuple):
    """A topic of the graph, with everybody at it.

    Args:
        problem: Why not everybody is known; empty where all are.
    """

    name: str
    types: list[str]
    publishers: list[Peer]
    subscribers: list[Peer]
    problem: str = ''


class RosNode:
    """A node without executor, parameters or services; endpoints are made of `handle`.

    Threads make and destroy them one at a time, under `endpoint_lock`: rmw_fastrtps has a lock for
    that, too, and a thread that waits for that one lets no Python go on.
    """

    def __init__(self, node: Any, context: Any) -> None:
        self.handle = node
        self.context = context
        self.endpoint_lock = threading.Lock()
        self.graph = Graph(self._changes)

    def publishers(self, topic: str) -> list[Peer]:
        """Who publishes on a topic, as far as discovery knows."""
        with told_by_others(f'publishers of {topic}'):
            return [_peer(info) for info in self.handle.get_publishers_info_by_topic(topic)]

    def subscribers(self, topic: str) -> list[Peer]:
        """Who subscribes to a topic, as far as discovery knows."""
        with told_by_others(f'subscribers of {topic}'):
            return [_peer(info) for info in self.handle.get_subscriptions_info_by_topic(topic)]

    def _changes(self) -> Changes | None:
        from ros2_kafka_bridge.ros import rcl  # noqa: PLC0415 (heavy)

        return rcl.GraphChanges(self.handle, self.context) if rcl.is_there() else None

    @property
    def domain_id(self) -> int:
        """The ROS domain in which it is."""
        return int(self.handle.context.get_domain_id())

    def topics(self) -> list[Topic]:
        """All topics of others, as far as discovery knows, sorted; those of ROS itself, too.

        One whose name is none of ROS is left out.
        """
        with told_by_others('the topics of the ROS graph'):
            own = self.handle.get_fully_qualified_name()
            names = sorted(name for name, _ in self.handle.get_topic_names_and_types())
        found = []
        for name in names:
            try:
                publishers, hidden = _of_others(self.publishers, name, own)
                subscribers, hidden_too = _of_others(self.subscribers, name, own)
            except ConfigError:
                continue
            types = sorted({peer.message_type for peer in publishers + subscribers})
            problem = hidden or hidden_too
            if types or problem:
                found.append(Topic(printable(name), types, publishers, subscribers, problem))
        return found


def _of_others(look: Callable[[str], list[Peer]], topic: str, own: str) -> tuple[list[Peer], str]:
    """Who else is there, and why that cannot be told.

    Raises:
        ConfigError: The name of the topic is none of ROS.
    """
    try:
        return [peer for peer in look(topic) if peer.node != own], ''
    except ConfigError:
        raise
    except BridgeError as error:
        return [], printable(str(error))


@contextmanager
def told_by_others(where: str) -> Iterator[None]:
    """Look at what others tell of themselves, which rclpy may not even be able to hand over.

    A name that is not UTF-8 comes out of it as a UnicodeDecodeError, and a duration below zero as
    an OverflowError.
    """
    with translated(where):
        try:
            yield
        except (ValueError, OverflowError) as error:
            raise RouteError(
                f'{where}: somebody in the ROS graph tells what cannot be read '
                f'({str(error)[:_LONGEST]})'
            ) from error


def is_of_a_stranger(error: BridgeError) -> bool:
    """Whether a look at the graph has failed for what somebody else tells there."""
    return isinstance(error.__cause__, ValueError | OverflowError)


def domain_in_words(domain_id: int | None) -> str:
    """Say which ROS domain is meant, and who chose it: None is that of the environment."""
    if domain_id is not None:
        return f'domain {domain_id}'
    if chosen := os.environ.get('ROS_DOMAIN_ID'):
        return f'domain {chosen} (ROS_DOMAIN_ID)'
    return 'domain 0 (the default)'


def node_name(bridge: str) -> str:
    """Make the name of a node of the bridge of that name."""
    return re.sub(r'\W', '_', f'{BRIDGE_PREFIX}{bridge}', flags=re.ASCII)


def worker_name(bridge: str, worker: int) -> str:
    """What a worker is called in the graph and at the broker; 0 is the bridge without workers.

    A number alone would make worker 1 of `warehouse` the bridge `warehouse-1`.
    """
    return f'{bridge}-worker-{worker}' if worker else bridge


def own_nodes(bridge: str) -> re.Pattern[str]:
    """What matches the names of the bridge's node and of its workers', with the namespace."""
    worker = node_name(worker_name(bridge, 1)).removesuffix('1')
    return re.compile(rf'/({node_name(bridge)}|{worker}\d+)')


def middleware() -> str:
    """The name of the middleware in use (`rmw_fastrtps_cpp`)."""
    import rclpy  # noqa: PLC0415 (heavy)

    return str(rclpy.utilities.get_rmw_implementation_identifier())


def is_fastdds() -> bool:
    """Whether the middleware in use is rmw_fastrtps."""
    return middleware().startswith(_FASTDDS)


@contextmanager
def open_node(name: str, domain_id: int | None, histories: Histories) -> Iterator[RosNode]:
    """Join the ROS graph with a node that has endpoints only.

    Raises:
        ConfigError: rclpy is missing or too old, or refuses the name or the environment.
        TransportError: Nothing can be written.
    """

    def make(context: Any) -> Any:
        import rclpy  # noqa: PLC0415 (heavy)
        from rclpy.parameter import Parameter  # noqa: PLC0415

        return rclpy.create_node(
            node_name(name),
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )

    with open_made(make, domain_id, histories) as node:
        yield node


@contextmanager
def open_made(
    make: Callable[[Any], Any], domain_id: int | None, histories: Histories
) -> Iterator[RosNode]:
    """Join the ROS graph with the node that `make` makes in a context.

    Raises:
        ConfigError: rclpy is missing or too old, or refuses the name or the environment.
        TransportError: Nothing can be written.
    """
    rclpy = import_rclpy()
    with ExitStack() as stack:
        with _STARTING:
            # Under the lock, too: another start names a file of its own for a moment.
            users = user_profile()
            place = 'ROS' if users is None else f'ROS, with the DDS profile {users}'
            with _profile(histories, users), translated(place):
                node = _joined(rclpy, make, domain_id, stack)
                if is_fastdds():
                    check_profile(node, users)
        yield node


def users_environ() -> dict[str, str]:
    """The environment, as the user has set it: a start shows Fast DDS another for a moment."""
    with _STARTING:
        return dict(os.environ)


def _joined(
    rclpy: Any, make: Callable[[Any], Any], domain_id: int | None, stack: ExitStack
) -> RosNode:
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415 (heavy)

    context = rclpy.Context()
    rclpy.init(
        args=_NO_LOG_FILES,
        context=context,
        domain_id=domain_id,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    stack.callback(context.try_shutdown)
    node = make(context)
    stack.callback(node.destroy_node)
    made = RosNode(node, context)
    stack.callback(made.graph.close)
    return made


def import_rclpy() -> Any:
    """Load rclpy.

    Raises:
        ConfigError: It is missing or too old.
        RouteError: It is broken.
    """
    try:
        with blamed('rclpy cannot be loaded'):
            import rclpy  # noqa: PLC0415 (heavy, and perhaps not there)

            check_alone()
            check_api(NeededBy.ROUTES)
    except RouteError as error:
        cause = error.__cause__
        if not isinstance(cause, ImportError):
            raise
        raise ConfigError([_why_not_loaded(cause)]) from error
    logging.getLogger(__name__).debug('rclpy is %s', rclpy.__file__)
    return rclpy


def _why_not_loaded(cause: ImportError) -> str:
    if cause.name == 'rclpy':
        return f'ROS 2 is not here ({cause}): {how_to_get_ros()}'
    return (
        f'ROS 2 is here, and {sys.executable} cannot load its rclpy ({cause}): a sourced ROS 2 '
        'needs its own Python, with a venv that has --system-site-packages and not the extra '
        '[ros]; the wheels need a terminal where none is sourced'
    )


@contextmanager
def _profile(histories: Histories, users: Path | None) -> Iterator[None]:
    """Show Fast DDS our profile while it starts; it reads the file once."""
    dialect = _dialect()
    text = make_profile(histories, users, dialect, check_topic())
    variables = (FASTDDS_2.variable, FASTDDS_3.variable)
    with written(text) as file:
        before = {variable: os.environ.pop(variable, None) for variable in variables}
        os.environ[dialect.variable] = str(file)
        try:
            yield
        finally:
            del os.environ[dialect.variable]
            os.environ |= {name: value for name, value in before.items() if value is not None}


def _dialect() -> Dialect:
    """Jazzy (rclpy 7) and older come with Fast DDS 2, Kilted (rclpy 9) with Fast DDS 3."""
    major = rclpy_major(rclpy_version())
    # Of an unknown version the profile is not taken, or is: `check_profile` looks.
    is_old = major is not None and major < _FIRST_WITH_FASTDDS_3
    return FASTDDS_2 if is_old else FASTDDS_3


def _peer(info: Any) -> Peer:
    type_hash = str(getattr(info, 'topic_type_hash', ''))
    # Whoever reaches the DDS network chooses these names; they are shown, logged and written.
    return Peer.of_qos(
        node=printable(f'{info.node_namespace.rstrip("/")}/{info.node_name}'),
        message_type=printable(info.topic_type),
        gid=bytes(info.endpoint_gid)[:16],
        type_hash=type_hash if type_hash.startswith('RIHS') else '',  # INVALID: not of ROS
        qos=info.qos_profile,
    )
