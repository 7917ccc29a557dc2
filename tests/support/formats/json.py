"""Messages as JSON, and back."""

from typing import Any

import pytest
from support.formats.messages import layout_of

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.json import make_decode, make_encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive

STRING = 'std_msgs/msg/String'
FLOAT64 = 'std_msgs/msg/Float64'
FLOAT32 = 'std_msgs/msg/Float32'
ODOMETRY = 'nav_msgs/msg/Odometry'
ODD_NAMES = Layout(
    'odd_msgs/msg/Names',
    tuple(
        Field(name, Primitive('uint8'))
        for name in ('class', 'f1', 'f0', 'self', 'None', '__doc__', '__init__', 'value', 'at')
    ),
)


def to_json(value: bytes, name: str, **settings: Any) -> str:
    return make_encode(layout_of(name), scope(settings))(value).decode()


def from_json(record: str | bytes | None, name: str, **settings: Any) -> bytes:
    value = record.encode() if isinstance(record, str) else record
    return make_decode(layout_of(name), scope(settings))(value)


def scope(settings: dict[str, Any]) -> Scope:
    return Scope('topic', JsonSettings(**settings))


def refusal(record: str | bytes | None, name: str, **settings: Any) -> str:
    with pytest.raises(DecodeError) as refused:
        from_json(record, name, **settings)
    return str(refused.value)
