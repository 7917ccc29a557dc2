"""Lyrical's second channel for pictures and clouds, where who takes bytes hears nothing.

rmw_fastrtps sends a type with an unbounded `uint8[]` on `<topic>/_buf_cpu` where all readers can
take that. A reader of bytes says that it can, and reads the first channel alone.
"""

from typing import Final

from ros2_kafka_bridge.message_types.installed import package_version
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, Sequence
from ros2_kafka_bridge.ros.installation import rclpy_major, rclpy_version
from ros2_kafka_bridge.ros.node import is_fastdds

_LYRICAL: Final = 10
_CURED: Final = (9, 5)


def unheard(layout: Layout) -> str:
    """Say that messages of a type may not come from ROS; empty where nothing is known of that."""
    if not _has_buffer(layout) or (rclpy_major(rclpy_version()) or 0) < _LYRICAL:
        return ''
    if not is_fastdds() or _is_cured():
        return ''
    return (
        f'{layout.type_name} holds uint8[]: rmw_fastrtps 9.4.6 and newer, before 9.5.0, may send '
        'it where the bridge hears nothing of it, and nobody tells: see that its messages come, '
        'or run the bridge on Kilted (docs/guarantees.md, Where they hold)'
    )


def _is_cured() -> bool:
    """Whether the rmw_fastrtps of this ROS is known to have the cure."""
    version = package_version('rmw_fastrtps_cpp')
    return bool(version) and tuple(map(int, version.split('.')[:2])) >= _CURED


def _has_buffer(kind: Kind) -> bool:
    """Whether the C++ of a type has a `rosidl::Buffer`: that of an unbounded uint8[] alone."""
    match kind:
        case Sequence(item=Primitive('uint8'), bound=None):
            return True
        case Layout():
            return any(_has_buffer(field.kind) for field in kind.fields)
        case Sequence() | Array():
            return _has_buffer(kind.item)
        case _:
            return False
