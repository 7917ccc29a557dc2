"""The settings of the formats that have some."""

from typing import Literal

from pydantic import Field

from ros2_kafka_bridge.config.base import Settings


class JsonSettings(Settings):
    """How JSON is written and read."""

    missing: Literal['error', 'default'] = Field(
        'error',
        description='A field that a record does not have: error makes it a dead letter, default '
        'takes the value that the message definition says, else zero or empty.',
    )
    unknown: Literal['error', 'ignore'] = Field(
        'error', description='A field that the message type does not have.'
    )
    bytes: Literal['base64', 'list'] = Field(
        'base64', description='How uint8[], byte[] and char[] appear.'
    )
    non_finite: Literal['string', 'null', 'error'] = Field(
        'string',
        description='How NaN and infinity appear: as "NaN", "Infinity" and "-Infinity", which '
        'come back; as null, which comes back as NaN; or as an error.',
    )
    integers: Literal['number', 'string'] = Field(
        'number',
        description='How 64-bit integers appear. As numbers they are exact here; some readers '
        'round what is beyond 2^53, and string is for them.',
    )


class SchemaSettings(Settings):
    """How avro and protobuf find their schema."""

    registry: bool = Field(
        True,  # noqa: FBT003 (its default)
        description='Whether records carry the id of their schema in the Schema Registry. '
        'Without it the schema is fixed: the one of the message type.',
    )
    auto_register: bool = Field(
        True,  # noqa: FBT003 (its default)
        description='Whether the bridge registers its schema; else it must be registered already.',
    )
    subject: Literal['topic', 'record', 'topic_record'] = Field(
        'topic', description='What the subject is named after in the Schema Registry.'
    )
