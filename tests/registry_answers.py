"""What the formats say of the answers of a Schema Registry."""

from typing import Any

import pytest
from avro_messages import ROBOT, scope_of

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode

ONCE = {'max.retries': 0, 'timeout': 30}
SECRET = 'swordfish-31b0'  # noqa: S105 (of a test)


def encode_error(url: str, properties: dict[str, Any] | None = None, **schema: Any) -> BridgeError:
    with pytest.raises(BridgeError) as raised:
        make_encode(ROBOT, scope_of(url, 'robots', ONCE | (properties or {}), **schema))
    return raised.value


def decode_error(url: str, value: bytes, properties: dict[str, Any] | None = None) -> BridgeError:
    decode = make_decode(ROBOT, scope_of(url, 'robots', ONCE | (properties or {})))
    with pytest.raises(BridgeError) as raised:
        decode(value)
    return raised.value
