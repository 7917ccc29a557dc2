"""What a route says about its format."""

import sys
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings
from ros2_kafka_bridge.kafka.properties import PropertyValue


class Scope(NamedTuple):
    """What a format knows of its route.

    Args:
        topic: The Kafka topic.
        json: The settings of `format: json`.
        schema: The settings of `format: avro` and `format: protobuf`.
        registry: The properties of the Schema Registry's client; empty where there is none.
        max_message_bytes: The most that a decoded message may have: a small value may become
            a large one.
    """

    topic: str
    json: JsonSettings = JsonSettings()
    schema: SchemaSettings = SchemaSettings()
    registry: Mapping[str, PropertyValue] = MappingProxyType({})
    max_message_bytes: int = sys.maxsize
