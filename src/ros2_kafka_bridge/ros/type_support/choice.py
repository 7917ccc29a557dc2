"""Whether endpoints are made without the packages of their types, in this ROS."""

import os
import threading
from typing import Final, NamedTuple

from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.message_types.installed import package_version
from ros2_kafka_bridge.ros.installation import rclpy_version
from ros2_kafka_bridge.ros.node import middleware
from ros2_kafka_bridge.ros.type_support.comparison import difference
from ros2_kafka_bridge.ros.type_support.self_test import self_test_problem
from ros2_kafka_bridge.threads.stop import Stop

_ONE_AT_A_TIME: Final = threading.Lock()
_known: Final[list[str]] = []  # of this process, as its middleware is
_TRIES: Final = 'nobody has tried these versions of ROS: tries whether types need their packages'
_MIDDLEWARE: Final = 'rmw_fastrtps_cpp'
_SIZES_COUNT: Final = 'RMW_FASTRTPS_USE_QOS_FROM_XML'


class Versions(NamedTuple):
    """The versions of what defines the structures, and of what reads them; empty: not told."""

    rclpy: str
    rcl: str
    rmw_fastrtps_cpp: str
    rmw_fastrtps_shared_cpp: str
    rosidl_runtime_c: str
    rosidl_typesupport_fastrtps_cpp: str
    rosidl_typesupport_introspection_c: str


TRIED: Final = frozenset(
    {
        Versions('7.1.5', '9.2.7', '8.4.3', '8.4.3', '4.6.6', '3.6.2', '4.6.6'),  # Jazzy
        Versions('9.1.2', '10.1.3', '9.3.3', '9.3.3', '4.9.5', '3.8.1', '4.9.5'),  # Kilted
    }
)
"""Those that the tests of the bridge run with."""


def why_import(stop: Stop | None = None) -> str:
    """Why the packages of message types have to be imported here; empty where they need not be.

    The first call tells it for the process. It takes seconds where nobody has tried these
    versions.

    Args:
        stop: Ends the waiting.
    """
    with _ONE_AT_A_TIME:
        if not _known:
            _known.append(_found_out(stop or Stop()))
        return _known[0]


def _found_out(stop: Stop) -> str:
    if middleware() != _MIDDLEWARE:
        return f'{middleware()} needs them'
    if os.environ.get(_SIZES_COUNT) == '1':
        return f'{_SIZES_COUNT}=1 lets profiles reserve memory, by the size of a type'
    if installed_versions() not in TRIED:
        route_log().info(_TRIES)
        if problem := self_test_problem(stop):
            return problem
    return difference()


def installed_versions() -> Versions:
    """The versions that are installed here."""
    return Versions(rclpy_version(), *map(package_version, Versions._fields[1:]))
