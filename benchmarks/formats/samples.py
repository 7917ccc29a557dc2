"""The messages that the formats are measured with, as CDR bytes."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Quaternion, Twist, Vector3
from geometry_msgs.msg import TwistWithCovariance as Velocity
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, JointState, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header, String

from ros2_kafka_bridge.formats.cdr import make_exact
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Layout

JOINTS: Final = 30
BEAMS: Final = 1080
POINTS: Final = 10_000
WIDTH: Final = 640
HEIGHT: Final = 480
SEED: Final = 1


class Sample(NamedTuple):
    """One message.

    Args:
        what: In words, for the table.
        python_class: What rclpy makes of it.
        cdr: As rclpy serializes it, without the padding behind.
    """

    what: str
    python_class: type[Any]
    layout: Layout
    cdr: bytes


def samples() -> list[Sample]:
    """Make one of each."""
    made: list[tuple[str, str, Callable[[random.Random], Any]]] = [
        ('String', 'std_msgs/msg/String', _string),
        ('Odometry', 'nav_msgs/msg/Odometry', _odometry),
        (f'JointState, {JOINTS} joints', 'sensor_msgs/msg/JointState', _joints),
        (f'LaserScan, {BEAMS:,} beams', 'sensor_msgs/msg/LaserScan', _scan),
        (f'PointCloud2, {POINTS:,} points', 'sensor_msgs/msg/PointCloud2', _cloud),
        (f'Image, {WIDTH} x {HEIGHT}', 'sensor_msgs/msg/Image', _image),
    ]
    return [_sample(*one) for one in made]


def _sample(what: str, type_name: str, make: Callable[[random.Random], Any]) -> Sample:
    message = make(random.Random(SEED))  # noqa: S311 (no secret)
    layout = load_layout(type_name)
    cdr = make_exact(layout)(bytes(serialize_message(message)))
    return Sample(what, type(message), layout, cdr)


def _string(_rng: random.Random) -> String:
    return String(data='order 4711: 12 boxes from shelf A7 to gate 3')


def _header(frame_id: str) -> Header:
    header = Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = 1_750_000_000, 123_456_789
    return header


def _odometry(rng: random.Random) -> Odometry:
    position = Point(x=rng.uniform(-50, 50), y=rng.uniform(-50, 50), z=0.0)
    yaw = rng.uniform(0, math.pi)
    turned = Quaternion(x=0.0, y=0.0, z=math.sin(yaw), w=math.cos(yaw))
    twist = Twist(linear=Vector3(x=rng.random()), angular=Vector3(z=rng.random()))
    return Odometry(
        header=_header('odom'),
        child_frame_id='base_link',
        pose=PoseWithCovariance(
            pose=Pose(position=position, orientation=turned), covariance=_covariance(rng)
        ),
        twist=Velocity(twist=twist, covariance=_covariance(rng)),
    )


def _covariance(rng: random.Random) -> list[float]:
    return [rng.random() if i % 7 == 0 else 0.0 for i in range(36)]


def _joints(rng: random.Random) -> JointState:
    return JointState(
        header=_header('base_link'),
        name=[f'arm_{i // 6}_joint_{i % 6}' for i in range(JOINTS)],
        position=[rng.uniform(-math.pi, math.pi) for _ in range(JOINTS)],
        velocity=[rng.gauss(0, 1) for _ in range(JOINTS)],
        effort=[rng.gauss(0, 10) for _ in range(JOINTS)],
    )


def _scan(rng: random.Random) -> LaserScan:
    return LaserScan(
        header=_header('laser'),
        angle_min=-2.356,
        angle_max=2.356,
        angle_increment=4.712 / BEAMS,
        range_min=0.1,
        range_max=30.0,
        ranges=[rng.uniform(0.1, 30) for _ in range(BEAMS)],
        intensities=[rng.uniform(0, 255) for _ in range(BEAMS)],
    )


def _cloud(rng: random.Random) -> PointCloud2:
    names = ('x', 'y', 'z', 'intensity')
    fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate(names)
    ]
    data = b''.join(struct.pack('<4f', *(rng.gauss(0, 10) for _ in names)) for _ in range(POINTS))
    return PointCloud2(
        header=_header('lidar'),
        height=1,
        width=POINTS,
        fields=fields,
        point_step=16,
        row_step=len(data),
        data=data,
        is_dense=True,
    )


def _image(rng: random.Random) -> Image:
    return Image(
        header=_header('camera'),
        height=HEIGHT,
        width=WIDTH,
        encoding='rgb8',
        step=3 * WIDTH,
        data=rng.randbytes(3 * WIDTH * HEIGHT),
    )
