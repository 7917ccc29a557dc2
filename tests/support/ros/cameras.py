"""Pictures of most of a megabyte, a camera that publishes one of them, and routes of pictures."""

from typing import Any

from rclpy.serialization import serialize_message
from support.formats.messages import new_message
from support.processes.harness import Bench, Process

IMAGE = 'sensor_msgs/msg/Image'
PICTURE_BYTES = 900_000


def picture(number: int = 0) -> bytes:
    """A picture in CDR, unlike those of other numbers."""
    return serialize_message(new_message(IMAGE, data=number.to_bytes(PICTURE_BYTES, 'little')))


def camera(bench: Bench, *options: str, rate: int = 60) -> Process:
    """Start a camera on /camera that goes on for long, unless the options say otherwise."""
    file = bench.place / 'picture'
    file.write_text(picture().hex())
    words = ('--type', IMAGE, '--file', str(file), '--times', '100000', '--rate', str(rate))
    return bench.publisher('/camera', *words, *options)


def from_camera(topic: str, **more: Any) -> dict[str, Any]:
    """A route of pictures from /camera to Kafka."""
    source = {'ros': '/camera'} | more.pop('source', {})
    return {
        'name': 'camera', 'from': source, 'to': {'kafka': topic}, 'format': 'cdr', **more,
    }  # fmt: skip
